"""Estimates along the way of the tip, read back from a run folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from palpate import Floats, LogError
from palpate_engine import RESULT
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.runs.result_file import open_table
from palpate_kit.runs.run_folder import RunFolder, TrackTable
from palpate_kit.runs.skin_places import skin_of, skin_places

_CONTINUATION_KEYS = (
    "trajectory",
    "run.seed",
    "run.rehearsal",
    "safety",
    "sink",
)  # what a continuation may have otherwise
_LAG_FLAG = "elsewhere"  # of a track whose estimator does not follow changes, where stretches of a path differ
_BETWEEN_PARTS = 1.0  # [s] from the end of a part to the begin of the next in a joined path: a pause for `sites_along`


@dataclass(frozen=True)
class Path2D:
    """The estimates of one parameter by one track, with the places of the tip; only those that can be used."""

    track: str
    parameter: str
    time: Floats  # (n,) [s]
    place: Floats  # (n, 2) [m] x and y of the tip; over a surface, of the skin that it presses
    value: Floats  # (n,) [SI]
    std: Floats  # (n,) [SI] as the estimator gives it
    nis: float  # mean normalised innovation squared; 1 where model and noise are right
    surface: Floats | None = None  # (n,) [m] as the estimator has it; None where not needed
    relief_sensitivity: float = 0.0  # [s/m] relative shift of its parameters by a speed at which the skin rises
    lags: bool = False  # it does not follow the changes along the path, as its verdict says
    others: Mapping[str, str] = field(default_factory=dict)  # parts that are by another track, and by which

    @property
    def source(self) -> str:
        """The track, in words, with the parts of the run that had to be read from another one."""
        return "; ".join([self.track, *(f"of {part}: {track}" for part, track in self.others.items())])


def read_path(folder: Path, track: str | None = None, parameter: str | None = None) -> Path2D:
    """Return the estimates of one parameter along the path of a run and its continuations, without rejected ones.

    Without names these are the first parameter of the best track.
    Each part is read from the first track that it has, in the order of `tracks_of`, which is that of every command: a
    part that was killed has no offline estimates. `Path2D.source` says which. Raises LogError for what is missing.
    """
    parts = _accepted(folder)
    if track is not None:
        _demand_known(folder, parts, track)
    # The parts that have estimates.
    named_paths: list[tuple[str, Path2D]] = []
    for part in parts:
        path = _read_part(part, track, parameter)
        if path is not None:
            named_paths.append((part.path.name, path))
    if not named_paths:
        _demand_estimates(folder, parts)
        raise LogError(
            f"{folder}: contains no estimates in contact with a place: set lateral_x or lateral_y in [alignment]"
        )
    joined = join_paths([path for _, path in named_paths])
    # Parts that are read from another track than most of the estimates.
    other_tracks = {name: path.track for name, path in named_paths if path.track != joined.track}
    return replace(joined, others=other_tracks)


def _accepted(folder: Path) -> list[RunFolder]:
    """Return the run and its continuations but for rejected ones; raises LogError where none is left."""
    run = RunFolder(folder)
    demand_one_pipeline(run)
    parts = [part for part in run.parts if "" not in part.rejected]
    if not parts:
        raise LogError(
            f"{folder}: was rejected: {run.rejected['']}; "
            f"`palpate repeat review {folder} --accept {folder.name}` undoes it"
        )
    return parts


def demand_one_pipeline(run: RunFolder) -> None:
    """Raise LogError where a continuation has other settings than the run, beyond motion, seed, limits and sinks."""
    text = run.pipeline_text if run.began else None
    if text is None:
        return
    for part in run.parts[1:]:
        if not part.began:
            continue
        if differing := differences(part.pipeline_text, text, _CONTINUATION_KEYS):
            raise LogError(f"{part.path}: is not a continuation of {run.path}, nothing is mixed: {differing}")


def _demand_estimates(folder: Path, parts: list[RunFolder]) -> set[str]:
    """Return the names of all tracks of a run's parts; raises LogError without any."""
    track_names = {name for part in parts for name in tracks_of(part.path)}
    if not track_names:
        raise LogError(f"{folder}: is not a run folder: it has no table of estimates")
    return track_names


def _demand_known(folder: Path, parts: list[RunFolder], track: str) -> None:
    """Raise LogError where no part has the track, or one that palpated lacks it."""
    track_names = _demand_estimates(folder, parts)
    if track not in track_names:
        raise LogError(f"{folder}: no track {track!r} (there are: {', '.join(sorted(track_names))})")
    for part in parts:
        _demand_track(part, track)


def join_paths(paths: Sequence[Path2D]) -> Path2D:
    """Return the paths of a run's parts as one, a second between each and the next; named by the track of most
    estimates."""
    count = Counter[str]()
    for path in paths:
        count[path.track] += len(path.time)
    main = next(path for path in paths if path.track == count.most_common(1)[0][0])
    delays = np.cumsum([0.0, *(path.time[-1] + _BETWEEN_PARTS for path in paths[:-1])])
    return Path2D(
        track=main.track,
        parameter=main.parameter,
        time=np.concatenate([path.time + delay for path, delay in zip(paths, delays, strict=True)]),
        place=np.concatenate([path.place for path in paths]),
        value=np.concatenate([path.value for path in paths]),
        std=np.concatenate([path.std for path in paths]),
        nis=float(np.mean([path.nis for path in paths])),
        surface=np.concatenate([path.surface for path in paths if path.surface is not None]),
        relief_sensitivity=main.relief_sensitivity,
        lags=any(path.lags for path in paths),
    )


def rejected_runs(folder: Path) -> dict[Path, str]:
    """Return the run and those of its continuations that a review has rejected, with the reasons."""
    return {part.path: part.rejected[""] for part in RunFolder(folder).parts if "" in part.rejected}


def _demand_track(part: RunFolder, track: str) -> None:
    """Raise LogError where a part palpated, but not with this track: a map of the rest would not include it."""
    there = tracks_of(part.path)
    if track in there:
        return
    if any(_read_part(part, other, None) is not None for other in there):
        raise LogError(
            f"{part.path}: has no estimates of {track}: it ended before they could be made (there are: "
            f"{', '.join(there)}); choose one of these with --track, or none for the best of each part"
        )


def tracks_of(folder: Path) -> list[str]:
    """Return the names of the tracks that one folder has estimates of, the best first.

    Those made afterwards come before online ones, then they are in the order of the table; but those whose result is
    invalid come last.
    """
    run = RunFolder(folder)
    results = run.result["tracks"] if run.finished else {}  # a map fills while the run goes on
    names = [name for table in run.tables for name in table.tracks]
    return sorted(names, key=lambda name: results.get(name, {}).get("verdict") == "invalid")


def _read_part(part: RunFolder, track: str | None, parameter: str | None) -> Path2D | None:
    """Return the path of a part by a track, or by its best one; None where it has no usable estimates of it."""
    tables = part.tables
    track = track or next(iter(tracks_of(part.path)), None)
    table = next((candidate for candidate in tables if track in candidate.tracks), None)
    if track is None or table is None:
        return None
    path = _path(part, table.track(track), track, parameter)
    result = part.result["tracks"].get(track, {}) if part.finished else {}
    with open_table(part.path / RESULT, f"tracks.{track}.details.relief_sensitivity"):
        sensitivity = float(result.get("details", {}).get("relief_sensitivity", 0.0))
    with open_table(part.path / RESULT, f"tracks.{track}.flags"):
        signs = [sign["code"] for flag in result.get("flags", ()) for sign in (flag, *flag.get("evidence", ()))]
    return replace(path, relief_sensitivity=sensitivity, lags=_LAG_FLAG in signs) if path is not None else None


def _path(part: RunFolder, table: TrackTable, track: str, parameter: str | None) -> Path2D | None:
    """Return the usable estimates of one track of a part of a run; None without any, LogError without the parameter.

    `table` has the track's estimates by their samples. Over a surface, places are those of the skin below the tip.
    """
    parameter = parameter or next(iter(table.values))
    if parameter not in table.values:
        raise LogError(f"{part.path}: {track} has no {parameter!r} (there are: {', '.join(table.values)})")
    known = np.isfinite(table.place)
    place = np.where(known.any(axis=0), table.place, 0.0)  # a sweep may know one coordinate only
    value, std = table.values[parameter], table.std[parameter]
    usable = table.usable & np.isfinite(value) & (value > 0) & np.isfinite(std)
    rows = usable & known.any(axis=1) & np.isfinite(place).all(axis=1)
    if not rows.any():
        return None
    if (skin := skin_of(part)) is not None:
        place[rows] = skin_places(skin, place[rows], table.position[rows])
    nis = table.others["nis"][rows]
    return Path2D(
        track=track,
        parameter=parameter,
        time=table.time[rows],
        place=place[rows],
        value=value[rows],
        std=std[rows],
        nis=float(np.nanmean(nis)) if np.isfinite(nis).any() else 1.0,
        surface=table.others["surface"][rows],
    )
