"""``palpate run --dry-run``: the motion, its limits and a drawing, without a robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import typer
from palpate import ConfigurationError, Trajectory
from palpate.host import MotionReport, Pipeline, SafetySettings, check_motion, check_own_motion, own_motions

_WIDTH, _HEIGHT = 72, 14  # characters of the drawing


def show_motion(pipeline: Pipeline) -> None:
    """Print every motion; raises ConfigurationError where one breaks the limits."""
    if not pipeline.trajectories:
        typer.echo(f"{pipeline.path}: nothing moves")
    broken = []
    for name, trajectory in pipeline.trajectories.items():
        typer.echo(f"trajectory {name}: {trajectory.total_duration:.2f} s; height of the tip, work frame")
        typer.echo("\n".join(drawing(trajectory)))
        if pipeline.safety is None:
            typer.echo("no [safety] table: there are no limits to check; a live robot would not move")
            continue
        report = check_motion(trajectory, pipeline.safety)
        typer.echo("\n".join(_lines(report, pipeline.safety)))
        broken += [f"trajectory {name}: {problem}" for problem in report.problems]
    if pipeline.safety is not None and pipeline.trajectories:
        broken += _own_motions(pipeline, pipeline.safety)
    if broken:
        raise ConfigurationError("\n".join([f"{pipeline.path}: the motion breaks its limits:", *broken]))


def _own_motions(pipeline: Pipeline, limits: SafetySettings) -> Iterator[str]:
    """Motions that arms make on their own, as far as known, with reports where they break the limits."""
    for name, own in own_motions(pipeline.devices).items():
        typer.echo(
            f"device {name}: moves to the start on its own, straight, from at most {1e3 * own.distance:g} mm away at "
            f"no more than {1e3 * own.speed:g} mm/s; checked against the box once the tip's position is known"
        )
        yield from (f"device {name}: {problem}" for problem in check_own_motion(own, limits))


def drawing(trajectory: Trajectory) -> Iterator[str]:
    """Height over time, in characters; ``#`` where it is meant for estimation."""
    times = np.linspace(0.0, trajectory.total_duration, 8 * _WIDTH)
    setpoint = trajectory.at(times)
    height = setpoint.position[:, 2]
    low, high = float(height.min()), float(height.max())
    rows = np.rint((high - height) / max(high - low, 1e-9) * (_HEIGHT - 1)).astype(int)
    canvas = [[" "] * _WIDTH for _ in range(_HEIGHT)]
    for i, row in enumerate(rows.tolist()):
        canvas[row][i // 8] = "#" if setpoint.measuring[i] else "."
    for i, line in enumerate(canvas):
        yield f"{1e3 * (high - (high - low) * i / (_HEIGHT - 1)):8.2f} mm |{''.join(line).rstrip()}"
    yield " " * 12 + "+" + "-" * _WIDTH


def _lines(report: MotionReport, limits: SafetySettings) -> Iterator[str]:
    for axis, name in enumerate("xyz"):
        low, high = 1e3 * limits.low[axis], 1e3 * limits.high[axis]
        yield f"  {name}: {1e3 * report.low[axis]:.2f} to {1e3 * report.high[axis]:.2f} mm (limits {low:g} to {high:g})"
    yield f"  speed: {1e3 * report.speed:.1f} mm/s (limit {1e3 * limits.speed:g})"
    yield f"  acceleration: {report.acceleration:.3f} m/s^2 (limit {limits.acceleration:g})"
    yield (
        f"  force: stops at {limits.stop_force:g} N, at most {report.peak_force:.1f} N by computation with "
        f"{1e-3 * limits.stiffness:g} N/mm and {1e3 * limits.reaction:g} ms (limit {limits.force:g} N)"
    )
