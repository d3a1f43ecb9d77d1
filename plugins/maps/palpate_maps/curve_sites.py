"""Sites of a folder of fits: each curve is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer
from palpate import LogError, suggest
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder, stale_words

from palpate_maps.path_reader import Path2D
from palpate_maps.sites import Sites

_Palpation = tuple[float, float, float, float]  # x and y [m], value and standard deviation [SI]


def read_curve_sites(
    path: Path, track: str | None = None, parameter: str | None = None, where: str | None = None
) -> tuple[Path2D, Sites]:
    """Return the values of a folder's curves at their places, less rejected and unusable ones, and the same as sites.

    `where` is a filter of the curves by their columns. A place is `x_m` and `y_m` of ``curves.csv``, else what the
    curve measured. Raises LogError for what is missing, ConfigurationError for filter words that do not parse.
    """
    folder = FitFolder(path)
    if not folder.tracks:
        raise LogError(f"{path}: no curve of it was fitted")
    chosen_track = track or folder.tracks[0]
    chosen_parameter = parameter or folder.values[0]
    for name, choices in ((chosen_track, folder.tracks), (chosen_parameter, folder.values)):
        if name not in choices:
            raise LogError(f"{path}: no {name!r}{suggest(name, choices)}")
    if stale := stale_words(folder):
        typer.echo(stale, err=True)
    # Of the chosen curves those that the track could use, with a place and a value.
    palpations: list[_Palpation] = []
    for row in curve_filter(where, folder).choose(folder.rows):
        if row.track == chosen_track and row.usable:
            palpation = _palpation_of(row, chosen_parameter)
            palpations += [] if palpation is None else [palpation]
    if not palpations:
        filter_text = f" and {where!r}" if where else ""
        raise LogError(
            f"{path}: has no usable curve with a place{filter_text}: give x_m and y_m in curves.csv, or lateral_x and "
            "lateral_y in [alignment]"
        )
    return _path_and_sites(palpations, chosen_track, chosen_parameter)


def _path_and_sites(palpations: list[_Palpation], track: str, parameter: str) -> tuple[Path2D, Sites]:
    """Return palpations as a path and as sites; each is one of its own, so no error is common to its neighbours."""
    x, y, value, std = np.array(palpations).T
    place = np.column_stack([x, y])
    time = np.arange(len(x), dtype=float)  # the order of the curves: when they were measured is not known
    path = Path2D(track=track, parameter=parameter, time=time, place=place, value=value, std=std, nis=1.0)
    standing = np.ones(len(x), bool)
    sites = Sites(place=place, log=np.log(value), std=std / value, time=time, standing=standing, kept=1.0)
    return path, sites


def _palpation_of(row: CurveRow, parameter: str) -> _Palpation | None:
    """Return place [m], value and standard deviation [SI] of a row; None where one is missing."""
    value, std, place = row.number(parameter), row.number(f"{parameter}_std"), row.place
    if value is None or std is None or place is None or value <= 0:
        return None
    return (*place, value, std)
