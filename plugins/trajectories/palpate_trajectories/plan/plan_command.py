"""``palpate check motion``: a motion before it is executed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Floats, Setpoint, contact_force, duration_of, setpoints_at, to_si
from palpate_engine import MotionReport, Pipeline, ask_devices, check_motion, load_pipeline
from palpate_kit.figures import save_figure
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption, Overrides

from palpate_trajectories.plan.plan_figure import plan_picture
from palpate_trajectories.plan.plan_text import (
    draw_height,
    fact_lines,
    own_motion_lines,
    own_motion_problems,
    safety_lines,
)

_STEP = 1e-3  # [s], a choice: instants at which a motion is checked
_MAX_STEPS = 2_000_000  # a choice: longer motions have a larger step
_MAX_DRAWN = 40_000  # a choice: instants in a figure


def plan(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    overrides: Overrides = None,
    expect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=VALUE", help="Expected material, for the force. [default: the simulated truth]"
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Picture to draw, too, .png or .svg.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Check the motion of a pipeline: duration, speeds, depth, expected force, limits; connect to nothing."""
    pipeline = load_pipeline(file, overrides or [])
    if not pipeline.trajectories:
        raise ConfigurationError(f"{file}: has no [trajectory.*] table to plan")
    facts_by_motion = dict[str, dict[str, Any]]()
    problems = list[str]()
    for name, trajectory in pipeline.trajectories.items():
        duration = duration_of(trajectory)
        time = np.arange(0.0, duration + _STEP, max(_STEP, duration / _MAX_STEPS))
        setpoint = setpoints_at(trajectory, time)
        # Its facts, the devices' own checks, and the limits.
        facts = _facts(pipeline, duration, time, setpoint, expect or [])
        facts_by_motion[name] = facts
        ask_devices(pipeline.devices, setpoint)
        report = check_motion(trajectory, pipeline.safety) if pipeline.safety else None
        if report is not None:
            facts["stop_force"] = report.peak_force
            problems += [f"trajectory {name}: {problem}" for problem in report.problems]
        # In words, and as a picture, which has the name of one motion among several.
        with print_aside(as_json):
            _print_motion(pipeline, name, facts, report)
            if out is not None:
                picture = out.with_stem(f"{out.stem}-{name}") if len(pipeline.trajectories) > 1 else out
                facts["picture"] = picture
                _draw(time, setpoint, name, picture)
                typer.echo(f"  drawn in {picture}")
    # Motions that arms make on their own, and the verdict.
    with print_aside(as_json):
        for line in own_motion_lines(pipeline):
            typer.echo(line)
    problems += own_motion_problems(pipeline)
    if problems:
        raise ConfigurationError("\n".join([f"{file}: the motion breaks the limits of [safety]:", *problems]))
    if as_json:
        print_json(facts_by_motion)


def _print_motion(pipeline: Pipeline, name: str, facts: dict[str, Any], report: MotionReport | None) -> None:
    """Print the height of a motion over time, its facts, and the check of its limits."""
    typer.echo(f"[trajectory.{name}], height of the tip in the work frame:")
    typer.echo("\n".join(draw_height(pipeline.trajectories[name], facts["duration"])))
    for line in (*fact_lines(pipeline, facts), *safety_lines(report, pipeline.safety)):
        typer.echo(f"  {line}")


def _draw(time: Floats, setpoint: Setpoint, name: str, path: Path) -> None:
    """Save the figure of a motion."""
    rows = slice(None, None, max(len(time) // _MAX_DRAWN, 1))
    image = plan_picture(time[rows], setpoint.position[rows], setpoint.velocity[rows], setpoint.measuring[rows], name)
    save_figure(image, path)


def _facts(pipeline: Pipeline, end: float, time: Any, setpoint: Setpoint, expect: list[str]) -> dict[str, Any]:
    """Return duration, speeds, extent and forces [SI] of a motion that ends at a time [s]."""
    position, velocity = setpoint.position, setpoint.velocity
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / np.diff(time)
    return {
        "duration": end,
        "measured": float(np.count_nonzero(setpoint.measuring)) / len(time) * end,
        "speed": float(np.linalg.norm(velocity, axis=1).max()),
        "acceleration": float(acceleration.max()),
        "low": position.min(axis=0).tolist(),
        "high": position.max(axis=0).tolist(),
        "forces": _largest_forces(pipeline, -position[:, 2], -velocity[:, 2], expect),
        "force_limits": _force_limits(pipeline),
    }


def _largest_forces(pipeline: Pipeline, depth: Floats, rate: Floats, expect: list[str]) -> dict[str, float | None]:
    """Return the largest force [N] by each model along depths and rates; None where its parameters are unknown."""
    forces: dict[str, float | None] = {}
    for name, model in pipeline.models.items():
        theta = _expected(pipeline, model, expect)
        forces[name] = None
        if theta is not None:
            force = contact_force(model, depth, rate, theta, (0.0,) * len(model.memory))
            forces[name] = float(np.maximum(force, 0.0).max())
    return forces


def _force_limits(pipeline: Pipeline) -> dict[str, float]:
    """Return the upper limit [N] of each force sensor that states one, that of its first channel."""
    limits = dict[str, float]()
    for name, device in pipeline.devices.items():
        for stream in device.streams:
            ranges = [channel.limits for channel in stream.channels if channel.limits]
            if stream.layout == "wrench" and ranges:
                limits.setdefault(name, ranges[0][1])
    return limits


def _expected(pipeline: Pipeline, model: Any, expect: list[str]) -> list[float] | None:
    """Return the model's parameters as expected, or the truth of a simulated rig; None where some are unknown."""
    values = pipeline.truth
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    for assignment in expect:
        name, _, text = assignment.partition("=")
        if name not in units:
            raise ConfigurationError(f"--expect: the model has no {name!r} (there are: {', '.join(units)})")
        try:
            values[name] = to_si(text, units[name])
        except ValueError as error:
            raise ConfigurationError(f"--expect: {name}: {error}") from error
    if not all(name in values for name in units):
        return None
    return [values[name] for name in units]
