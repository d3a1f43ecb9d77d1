"""Pictures of runs and records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, Samples, suggest
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, label_forces, legend_outside, style
from palpate_kit.runs.run_folder import TrackTable

from palpate_notebook.figure_object import Picture
from palpate_notebook.run_data import RunData

_MAX_POINTS = 20_000  # of a curve, a choice: more than pixels, and fast to draw
_PANEL_COLUMNS = 2  # a choice
_MILLI = 1e3  # [mm/m]


class Plots:
    """Pictures of a run."""

    def __init__(self, run: RunData) -> None:
        self._run = run

    def __call__(self, *parameters: str) -> Picture:
        """Return parameters over time, a panel each: tracks with bands of two standard deviations, and the truth."""
        units = _parameter_units(self._run)
        for name in parameters:
            if name not in units:
                raise ConfigurationError(f"no track has {name!r}{suggest(name, units)}")
        return Picture(_parameters_over_time(self._run, list(parameters) or list(units), units))

    def force_depth(self, *tracks: str) -> Picture:
        """Return measured and modelled force over depth, a panel for each track."""
        names = [self._run[name].name for name in tracks] or _shown_tracks(self._run)
        return Picture(_force_panels(self._run, names, over_depth=True))

    def force(self, *tracks: str) -> Picture:
        """Return measured and modelled force over time, a panel for each track."""
        names = [self._run[name].name for name in tracks] or _shown_tracks(self._run)
        return Picture(_force_panels(self._run, names, over_depth=False))


def _shown_tracks(run: RunData) -> list[str]:
    """Return the tracks whose verdict is not "invalid"; all of them if all are."""
    return [name for name, track in run.tracks.items() if track.verdict != "invalid"] or list(run.tracks)


def _parameter_units(run: RunData) -> dict[str, str]:
    """Return the SI unit of each parameter of any track, by its name."""
    tracks = run.document["tracks"].values()
    return {name: entry["unit"] for track in tracks for name, entry in track["parameters"].items()}


def _panel_grid(count: int, height: float = 55.0) -> tuple[Any, list[Any]]:
    """Return a figure and its axes, one for each of `count` panels of a height [mm]."""
    columns = min(count, _PANEL_COLUMNS)
    rows = -(-count // _PANEL_COLUMNS)  # rounded up
    figure, axes = figure_of(max(columns, 1), max(rows, 1), height=height)
    flat = list(axes.ravel())
    for axis in flat[count:]:
        axis.set_axis_off()
    return figure, flat[:count]


@style()
def _parameters_over_time(run: RunData, parameters: list[str], units: dict[str, str]) -> Any:
    """Return the figure of parameters over time, a panel for each; `units` are SI, by parameter."""
    figure, axes = _panel_grid(len(parameters))
    for axis, parameter in zip(axes, parameters, strict=True):
        unit, factor = display_unit(units[parameter])
        curves: list[Floats] = []
        for track in _shown_tracks(run):
            table = run.track_tables.get(track)
            if table is not None and parameter in table.values:
                curves.append(_draw_estimates(axis, table, track, parameter, factor))
        if parameter in run.truth:
            axis.axhline(factor * run.truth[parameter], color="black", linestyle=":", linewidth=0.8, label="truth")
        axis.set_ylim(common_limits(curves))
        axis.set(xlabel="time [s]", ylabel=f"{parameter} [{unit}]")
        legend_outside(axis)
    return figure


def _draw_estimates(axis: Any, table: TrackTable, track: str, parameter: str, factor: float) -> Floats:
    """Draw the estimates of a parameter times a factor, with a band of two standard deviations; return them (n,)."""
    rows = _thinned(np.flatnonzero(table.usable & np.isfinite(table.values[parameter])))
    time = table.time[rows]
    value: Floats = factor * table.values[parameter][rows]
    std = factor * table.std[parameter][rows]
    (line,) = axis.plot(time, value, label=track)
    axis.fill_between(time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
    return value


@dataclass(frozen=True)
class _ForceCurves:
    """Measured and modelled contact force (n,) [N] of a track, over time (n,) [s] and depth (n,) [mm]."""

    time: Floats
    depth: Floats
    measured: Floats
    modelled: Floats


def _force_curves(run: RunData, track: str) -> _ForceCurves:
    """Return the forces of a track at its estimates."""
    samples = run.aligned
    table = run.track_tables[track]
    rows = _thinned(np.flatnonzero(table.usable & np.isfinite(table.others["force"])))
    time = table.time[rows]
    position = np.interp(time, samples.time, samples.position)
    return _ForceCurves(
        time=time,
        depth=_MILLI * (table.others["surface"][rows] - position),
        measured=np.interp(time, samples.time, run.contact_force),
        modelled=table.others["force"][rows],
    )


def _draw_forces(axis: Any, curves: _ForceCurves, track: str, over_depth: bool) -> None:
    """Draw measured force as points and modelled force as a line, over depth or over time."""
    abscissa = curves.depth if over_depth else curves.time
    axis.plot(abscissa, curves.measured, ".", markersize=1, color="0.6", label="measured")
    axis.set_prop_cycle(None)  # the model has the first colour
    axis.plot(abscissa, curves.modelled, linewidth=0.8, label=track)
    axis.set(xlabel="depth [mm]" if over_depth else "time [s]", ylabel="contact force [N]")
    legend_outside(axis)


@style()
def _force_panels(run: RunData, tracks: list[str], over_depth: bool) -> Any:
    """Return the figure of measured and modelled force, a panel for each track."""
    figure, axes = _panel_grid(len(tracks))
    for axis, track in zip(axes, tracks, strict=True):
        _draw_forces(axis, _force_curves(run, track), track, over_depth)
    return figure


@style()
def samples_picture(samples: Samples, title: str) -> Picture:
    """Return a picture of force, height and velocity over time."""
    figure, axes = figure_of(1, 3, height=35.0)
    rows = _thinned(np.arange(len(samples)))
    columns = (
        (samples.force, "force [N]"),
        (_MILLI * samples.position, "height [mm]"),
        (_MILLI * samples.velocity, "velocity [mm/s]"),
    )
    for axis, (column, label) in zip(axes[:, 0], columns, strict=True):
        axis.plot(samples.time[rows], column[rows], linewidth=0.8)
        axis.set_ylabel(label)
    axes[0, 0].set_title(title)
    axes[-1, 0].set_xlabel("time [s]")
    return Picture(figure)


def _thinned(rows: Any) -> Any:
    """Return every k-th of the rows (n,), so that no more than about `_MAX_POINTS` are left."""
    return rows[:: max(len(rows) // _MAX_POINTS, 1)]


@style()
def fit_picture(run: RunData, track: str) -> Picture:
    """Return a picture of measured and modelled force over time and over depth, and of the residual over time."""
    curves = _force_curves(run, track)
    figure, axes = figure_of(3)
    over_time, over_depth, residual_axis = axes[0]
    _draw_forces(over_time, curves, track, over_depth=False)
    _draw_forces(over_depth, curves, track, over_depth=True)
    residual_axis.plot(curves.time, curves.measured - curves.modelled, ".", markersize=1, label="measured less model")
    residual_axis.set(xlabel="time [s]")
    label_forces(residual_axis, "residual")
    legend_outside(residual_axis)
    return Picture(figure)
