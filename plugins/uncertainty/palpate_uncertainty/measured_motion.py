"""The motion that a track measured: its frequency or speed and its depths, which its values are of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Diagnosed, Floats, TrackEvidence
from palpate_engine import Result, verdict_rank
from palpate_kit.terminal.motion_text import measured_text, motion_numbers

from palpate_uncertainty.undeclared_thickness import half_space_from
from palpate_uncertainty.whiteness import oscillation

WAY_IN = (0.1, 0.9)  # of the depths (choice), between which the way in is timed: noise moves neither crossing much
AT_TOUCH = 0.02  # of the deepest depth (choice); a press whose first sample is above that begins at the touch


def measured_motion(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return a table of the motion of each track on a point, and how thick its stated half-space has to be."""
    tables = {track.name: motion_table(track) for track in tracks if not (track.ending and track.ending.is_sweep)}
    return {name: Diagnosed(table=table) for name, table in tables.items() if table}


def motion_lines(result: Result) -> list[str]:
    """Return the motion that the best track of a run measured, in words; nothing of a sweep."""
    tracks = sorted(result.tracks.values(), key=lambda track: verdict_rank(track.verdict))
    tables = [track.diagnoses["motion"] for track in tracks if track.diagnoses.get("motion")]
    return [f"measured: {measured_text([motion_numbers(table)])}" for table in tables[:1]]


def motion_table(track: TrackEvidence) -> dict[str, Any]:
    """Return `frequency` [Hz] or `speed` [m/s], `depth` (2,) [m] and `half_space_from` [m]; empty out of contact.

    The depths of an oscillation are those of its turns, of any other motion those that it reached.
    """
    rows = track.kept.used & np.isfinite(track.kept.position)
    time, height = track.kept.time[rows], track.kept.position[rows]
    depth = track.surface - height
    if len(depth) < 2 or not np.max(depth) > 0:
        return {}
    # An oscillation has a frequency and turns, any other motion a speed of its way in.
    rhythm = oscillation(time, height)
    if rhythm is not None:
        frequency, _ = rhythm
        table: dict[str, Any] = {"frequency": frequency, "depth": turns(time, depth, frequency)}
    else:
        speed = approach_speed(time, depth)
        # A press whose first sample is close to the touch began at depth 0.
        shallowest = float(np.min(depth)) if np.min(depth) > AT_TOUCH * _max(depth) else 0.0
        table = ({} if speed is None else {"speed": speed}) | {"depth": [shallowest, _max(depth)]}
    if getattr(track.model, "thickness", None) == "half-space" and (thick := _half_space(track)) is not None:
        table["half_space_from"] = thick
    return table


def turns(time: Floats, depth: Floats, frequency: float) -> list[float]:
    """Return the shallow and the deep turn [m] of an oscillation [Hz], the medians over its periods."""
    period = np.floor((time - time[0]) * frequency)
    starts = np.flatnonzero(np.diff(period, prepend=-1.0))
    shallow, deep = np.minimum.reduceat(depth, starts), np.maximum.reduceat(depth, starts)
    return [max(float(np.median(shallow)), 0.0), float(np.median(deep))]


def approach_speed(time: Floats, depth: Floats) -> float | None:
    """Return the mean speed [m/s] of the first way in; None where the record does not show one."""
    low = max(float(depth[0]), 0.0)
    levels = [low + part * (_max(depth) - low) for part in WAY_IN]
    begin, end = (int(np.argmax(depth >= level)) for level in levels)
    if end <= begin or time[end] <= time[begin]:
        return None
    return float((depth[end] - depth[begin]) / (time[end] - time[begin]))


def _max(depth: Floats) -> float:
    """Return the deepest depth [m]."""
    return float(np.max(depth))


def _half_space(track: TrackEvidence) -> float | None:
    """Return the thickness [m] above which a bonded layer moves the elasticity by less than its uncertainty.

    None without an elasticity, or where its uncertainty is unknown or 0.
    """
    roles = [parameter.role for parameter in track.model.parameters]
    if "elastic" not in roles:
        return None
    place = roles.index("elastic")
    share = float(track.combined[place] / abs(track.values[place])) if track.values[place] else np.nan
    return half_space_from(track, share) if np.isfinite(share) and share > 0 else None
