"""A motion as text: facts next to the limits of [safety], and its height over time in characters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from palpate import Trajectory, setpoints_at
from palpate_engine import MotionReport, Pipeline, SafetySettings, check_own_motion, own_motions

_MM = 1e3  # per metre, and milliseconds per second
_WIDTH = 72  # characters, a choice: width of the drawing
_HEIGHT = 14  # lines, a choice: height of the drawing
_TIMES_PER_CHARACTER = 8  # a choice: instants that are drawn in one column
_MARGIN = 12  # characters in front of the drawing, those of "12345.67 mm "
_MIN_RANGE = 1e-9  # [m], a choice: a level motion is a line


def draw_height(trajectory: Trajectory, end: float) -> Iterator[str]:
    """Yield the height over the time until its end [s], in characters; ``#`` where it is meant for estimation."""
    # The row of each instant's height, the highest on top.
    times = np.linspace(0.0, end, _TIMES_PER_CHARACTER * _WIDTH)
    setpoint = setpoints_at(trajectory, times)
    height = setpoint.position[:, 2]
    low, high = float(height.min()), float(height.max())
    rows = np.rint((high - height) / max(high - low, _MIN_RANGE) * (_HEIGHT - 1)).astype(int)
    # A cell is marked by the last of its instants; then the rows, each with its height.
    canvas = [[" "] * _WIDTH for _ in range(_HEIGHT)]
    for i, row in enumerate(rows.tolist()):
        canvas[row][i // _TIMES_PER_CHARACTER] = "#" if setpoint.measuring[i] else "."
    for i, line in enumerate(canvas):
        level = high - (high - low) * i / (_HEIGHT - 1)
        yield f"{_MM * level:8.2f} mm |{''.join(line).rstrip()}"
    yield " " * _MARGIN + "+" + "-" * _WIDTH


def fact_lines(pipeline: Pipeline, facts: Mapping[str, Any]) -> Iterator[str]:
    """Yield the facts of a motion [SI], each with its limit where the pipeline has one."""
    limits = pipeline.safety  # of [safety]; a force that needs an unknown parameter is None
    yield f"duration      {facts['duration']:.2f} s, of which {facts['measured']:.2f} s are measured"
    speed = f" (limit {_MM * limits.speed:g})" if limits else ""
    yield f"speed         at most {_MM * facts['speed']:.3g} mm/s{speed}"
    acceleration = f" (limit {limits.acceleration:g})" if limits else ""
    yield f"acceleration  at most {facts['acceleration']:.3g} m/s^2{acceleration}"
    for axis, (name, low, high) in enumerate(zip("xyz", facts["low"], facts["high"], strict=True)):
        box = f" (limits {_MM * limits.low[axis]:g} to {_MM * limits.high[axis]:g})" if limits else ""
        yield f"{name}             {_MM * low:.4g} to {_MM * high:.4g} mm{box}"
    for name, force in facts["forces"].items():
        parameter = pipeline.models[name].parameters[0].name
        if force is None:
            yield f"force         unknown: give --expect {parameter}=VALUE and the rest of {name}"
        else:
            yield f"force         up to {force:.3g} N, by model {name} on a level surface at z = 0"
    for name, limit in facts["force_limits"].items():
        yield f"limit         {name} senses forces up to {limit:.4g} N"


def safety_lines(report: MotionReport | None, limits: SafetySettings | None) -> Iterator[str]:
    """Yield the check of the limits, and the force with which the tip presses when it is stopped."""
    if report is None or limits is None:
        yield "safety        no limits to check, for [safety] is missing; a live robot would not move"
        return
    if not report.problems:
        yield "safety        every limit of [safety] is kept"
    yield (
        f"stop          at {limits.stop_force:g} N; at most {report.peak_force:.1f} N by computation with "
        f"{1e-3 * limits.stiffness:g} N/mm and {_MM * limits.reaction:g} ms (limit {limits.force:g} N)"
    )
    yield (
        "sensor        one that reads too little is not noticed on unknown material: at most "
        f"{report.unfelt_force:.1f} N then, by the deepest setpoint"
    )


def own_motion_lines(pipeline: Pipeline) -> Iterator[str]:
    """Yield the motions that arms make on their own."""
    for name, motion in own_motions(pipeline.devices).items():
        yield (
            f"device {name}: moves to the start on its own, straight, from at most {_MM * motion.distance:g} mm away "
            f"at no more than {_MM * motion.speed:g} mm/s; checked against the box once the tip's position is known"
        )


def own_motion_problems(pipeline: Pipeline) -> Iterator[str]:
    """Yield the limits that motions of arms on their own break, as far as known before they connect."""
    if pipeline.safety is None:
        return
    for name, motion in own_motions(pipeline.devices).items():
        yield from (f"device {name}: {problem}" for problem in check_own_motion(motion, pipeline.safety))
