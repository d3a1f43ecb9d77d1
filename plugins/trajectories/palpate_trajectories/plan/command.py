"""``palpate plan``: look at a motion before it is made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Setpoint, Trajectory, contact_force, to_si
from palpate.host import (
    JsonOption,
    Overrides,
    Pipeline,
    aside,
    ask_devices,
    demand_safe,
    load_pipeline,
    print_json,
    save_figure,
    truth_of,
)

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
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture to draw, .png or .svg. [default: NAME-plan.png]")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check the motion of a pipeline without moving: duration, speeds, depth, expected force, and a picture."""
    pipeline = load_pipeline(file, overrides or [])
    if not pipeline.trajectories:
        raise ConfigurationError(f"{file}: has no [trajectory.*] table to plan")
    answer = {}
    for name, trajectory in pipeline.trajectories.items():
        end = trajectory.total_duration
        time = np.arange(0.0, end + _STEP, max(_STEP, end / _MOST))
        setpoint = trajectory.at(time)
        with aside(as_json):
            typer.echo(f"[trajectory.{name}]")
            found = answer[name] = _facts(pipeline, trajectory, time, setpoint, expect or [])
            for line in _lines(pipeline, found):
                typer.echo(f"  {line}")
            ask_devices(pipeline.devices, setpoint)
            if pipeline.safety is not None:
                found["stop_force"] = demand_safe(trajectory, pipeline.safety, str(pipeline.path)).peak_force
                kept = f"every limit of [safety] is kept; at most {found['stop_force']:.3g} N when it stops"
                typer.echo(f"  safety        {kept}")
            path = out or Path(f"{file.stem}-plan.png")
            if len(pipeline.trajectories) > 1:
                path = path.with_stem(f"{path.stem}-{name}")
            rows = slice(None, None, max(len(time) // 40_000, 1))
            image = plan_picture(
                time[rows], setpoint.position[rows], setpoint.velocity[rows], setpoint.measuring[rows], name
            )
            save_figure(image, path)
            found["picture"] = path
            typer.echo(f"  drawn in {path}")
    if as_json:
        print_json(answer)


def _facts(
    pipeline: Pipeline, trajectory: Trajectory, time: Any, setpoint: Setpoint, expect: list[str]
) -> dict[str, Any]:
    """What the motion is and asks for [SI]."""
    place, velocity = setpoint.position, setpoint.velocity
    forces: dict[str, float | None] = {}
    for name, model in pipeline.models.items():
        theta = _expected(pipeline, model, expect)
        depth, rate = -place[:, 2], -velocity[:, 2]
        forces[name] = None
        if theta is not None:
            force = contact_force(model, depth, rate, theta, (0.0,) * len(model.memory))
            forces[name] = float(np.maximum(force, 0.0).max())
    limits = {
        name: [c.limits[1] for s in device.streams if s.layout == "wrench" for c in s.channels if c.limits]
        for name, device in pipeline.devices.items()
    }
    return {
        "duration": trajectory.total_duration,
        "measured": float(np.count_nonzero(setpoint.measuring)) / len(time) * trajectory.total_duration,
        "speed": float(np.linalg.norm(velocity, axis=1).max()),
        "acceleration": float((np.linalg.norm(np.diff(velocity, axis=0), axis=1) / np.diff(time)).max()),
        "low": place.min(axis=0).tolist(),
        "high": place.max(axis=0).tolist(),
        "forces": forces,
        "force_limits": {name: known[0] for name, known in limits.items() if known},
    }


def _lines(pipeline: Pipeline, found: Mapping[str, Any]) -> Iterator[str]:
    yield f"duration      {found['duration']:.2f} s, of which {found['measured']:.2f} s are measured"
    yield f"speed         at most {1e3 * found['speed']:.3g} mm/s"
    yield f"acceleration  at most {found['acceleration']:.3g} m/s^2"
    for name, low, high in zip("xyz", found["low"], found["high"], strict=True):
        yield f"{name}             {1e3 * low:.4g} to {1e3 * high:.4g} mm"
    for name, force in found["forces"].items():
        first = pipeline.models[name].parameters[0].name
        if force is None:
            yield f"force         unknown: give --expect {first}=VALUE and the rest of {name}"
        else:
            yield f"force         up to {force:.3g} N, by model {name} on a level surface at z = 0"
    for name, limit in found["force_limits"].items():
        yield f"limit         {name} senses forces up to {limit:.4g} N"


def _expected(pipeline: Pipeline, model: Any, expect: list[str]) -> list[float] | None:
    """The model's parameters as expected, or the truth of a simulated rig; None where some are not known."""
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
