"""``palpate plan``: look at a motion before it is made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Setpoint, Trajectory, contact_force, to_si
from palpate.host import Overrides, Pipeline, ask_devices, demand_safe, load_pipeline, save_figure, truth_of

from palpate_trajectories.plan.picture import plan_picture

_STEP = 1e-3  # [s]
_MOST = 2_000_000


def plan(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    overrides: Overrides = None,
    expect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=VALUE", help="Expected material, for the force. [default: the simulated truth]"
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Picture to draw, .png or .svg. [default: NAME-plan.png]")] = None,
) -> None:
    """Check the motion of a pipeline without moving: duration, speeds, depth, expected force, and a picture."""
    pipeline = load_pipeline(file, overrides or [])
    if not pipeline.trajectories:
        raise ConfigurationError(f"{file}: has no [trajectory.*] table to plan")
    for name, trajectory in pipeline.trajectories.items():
        end = trajectory.total_duration
        time = np.arange(0.0, end + _STEP, max(_STEP, end / _MOST))
        setpoint = trajectory.at(time)
        typer.echo(f"[trajectory.{name}]")
        for line in _facts(pipeline, trajectory, time, setpoint, expect or []):
            typer.echo(f"  {line}")
        path = out or Path(f"{file.stem}-plan.png")
        if len(pipeline.trajectories) > 1:
            path = path.with_stem(f"{path.stem}-{name}")
        rows = slice(None, None, max(len(time) // 40_000, 1))
        image = plan_picture(
            time[rows], setpoint.position[rows], setpoint.velocity[rows], setpoint.measuring[rows], name
        )
        save_figure(image, path)
        typer.echo(f"  drawn in {path}")


def _facts(
    pipeline: Pipeline, trajectory: Trajectory, time: Any, setpoint: Setpoint, expect: list[str]
) -> Iterator[str]:
    place, velocity = setpoint.position, setpoint.velocity
    speed = np.linalg.norm(velocity, axis=1)
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / np.diff(time)
    measured = float(np.count_nonzero(setpoint.measuring)) / len(time) * trajectory.total_duration
    yield f"duration      {trajectory.total_duration:.2f} s, of which {measured:.2f} s are measured"
    yield f"speed         at most {1e3 * speed.max():.3g} mm/s"
    yield f"acceleration  at most {acceleration.max():.3g} m/s^2"
    for axis, name in enumerate("xyz"):
        yield f"{name}             {1e3 * place[:, axis].min():.4g} to {1e3 * place[:, axis].max():.4g} mm"
    for name, model in pipeline.models.items():
        theta = _expected(pipeline, model, expect)
        if theta is None:
            yield f"force         unknown: give --expect {model.parameters[0].name}=VALUE and the rest of {name}"
            continue
        depth, rate = -place[:, 2], -velocity[:, 2]
        force = np.maximum(contact_force(model, depth, rate, theta, (0.0,) * len(model.memory)), 0.0)
        yield f"force         up to {force.max():.3g} N, by model {name} on a level surface at z = 0"
    for name, device in pipeline.devices.items():
        limits = [c.limits for s in device.streams if s.layout == "wrench" for c in s.channels if c.limits]
        if limits:
            yield f"limit         {name} senses forces up to {limits[0][1]:.4g} N"
    ask_devices(pipeline.devices, setpoint)
    if pipeline.safety is not None:
        report = demand_safe(trajectory, pipeline.safety, str(pipeline.path))
        yield f"safety        every limit of [safety] is kept; at most {report.peak_force:.3g} N when it stops"


def _expected(pipeline: Pipeline, model: Any, expect: list[str]) -> list[float] | None:
    """The model's parameters as expected, or as a simulated rig knows them; None where some are not known."""
    known = truth_of(pipeline.devices)
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    for assignment in expect:
        name, _, text = assignment.partition("=")
        if name not in units:
            raise ConfigurationError(f"--expect: the model has no {name!r} (there are: {', '.join(units)})")
        try:
            known[name] = to_si(text, units[name])
        except ValueError as error:
            raise ConfigurationError(f"--expect: {name}: {error}") from error
    return [known[name] for name in units] if all(name in known for name in units) else None
