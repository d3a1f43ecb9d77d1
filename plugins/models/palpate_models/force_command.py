"""``palpate model force``: the forces of a model and a tip over a ramp or a sine, before anything is palpated."""

from __future__ import annotations

import csv
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
import typer
from palpate import (
    ConfigurationError,
    ContactModel,
    Floats,
    OutputError,
    force_over_time,
    is_number,
    suggest,
    tip_profile,
    to_si,
)
from palpate_engine import Source, build_parts, registry as registries
from palpate_kit.figures import figure_of, save_figure, style
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption

_SAMPLES = 1001


@dataclass(frozen=True)
class _ForceCurve:
    """Depth, rate and force over time [SI]."""

    time: Floats
    depth: Floats
    rate: Floats
    force: Floats


def force(
    file: Annotated[Path | None, typer.Argument(help="A pipeline file; left out: give --model and --indenter.")] = None,
    model: Annotated[
        str | None, typer.Option(help="A [model.NAME] of the file; without a file, a part such as kelvin-voigt.")
    ] = None,
    indenter: Annotated[str | None, typer.Option(help="Without a file: a tip, such as exact-sphere.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Without a file indenter.radius='5 mm'; with one table.key=..."
        ),
    ] = None,
    parameters: Annotated[
        list[str] | None, typer.Option("--parameter", metavar="NAME=VALUE", help="Such as elasticity='112 kPa'.")
    ] = None,
    depth: Annotated[str, typer.Option(help="Deepest depth of the ramp, or mean depth of the sine.")] = "3 mm",
    speed: Annotated[str, typer.Option(help="Speed of the ramp.")] = "1 mm/s",
    amplitude: Annotated[str, typer.Option(help="Amplitude of the sine.")] = "1 mm",
    frequency: Annotated[str | None, typer.Option(help="Frequency of a sine, in place of the ramp.")] = None,
    cycles: Annotated[int, typer.Option(help="Cycles of the sine, after one that fades in.", min=1, max=1000)] = 3,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="CSV file; left out: the terminal.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Picture to write: .png, .svg or .pdf.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the force of a model and a tip over a depth ramp or a sine, as CSV and as a picture."""
    chosen = _from_file(file, model, overrides or []) if file else _by_name(model, indenter, overrides or [])
    name, part = chosen
    theta = _theta(part, parameters or [])
    motion = _ramp(depth, speed) if frequency is None else _sine(depth, amplitude, frequency, cycles)
    time, depths, rates = motion
    try:
        forces = force_over_time(part, time, depths, rates, theta, pulls=False)
    except ValueError as error:
        raise ConfigurationError(f"palpate model force: {error}") from error
    curve = _ForceCurve(time, depths, rates, forces)
    problem = part.validity(float(np.max(depths)))
    if problem:
        typer.echo(f"palpate model force: {problem}", err=True)
    if as_json:
        units = {"time": "s", "depth": "m", "rate": "m/s", "force": "N"}
        print_json({"model": name, "units": units, "warning": problem or None, **vars(curve)})
    if out is not None or not as_json:
        _write(curve, out)
    if picture is not None:
        _draw(curve, part, name, picture)


def _by_name(model: str | None, indenter: str | None, overrides: list[str]) -> tuple[str, ContactModel]:
    registry = registries.load()
    if model is None:
        model = "dimensionality-reduction"
    needs = "indenter" in registry.find("model", model).model_fields
    tables = [f'[model.model]\ntype = "{model}"\n']
    if indenter is not None and needs:
        tables[0] += 'indenter = "tip"\n'
        tables.append(f'[indenter.tip]\ntype = "{indenter}"\n')
    elif indenter is not None:
        raise ConfigurationError(f"palpate model force: the model {model!r} takes no indenter")
    source = Source("".join(tables), Path("palpate model force"))
    for assignment in overrides:
        table, _, rest = assignment.partition(".")
        place = {"model": "model.model", "indenter": "indenter.tip"}.get(table)
        if place is None or (table == "indenter" and indenter is None):
            raise ConfigurationError(f"--set {assignment}: write model.KEY=VALUE or indenter.KEY=VALUE")
        source.override(f"{place}.{rest}")
    found: dict[str, ContactModel] = build_parts(source, "model", registry)
    return model, found["model"]


def _from_file(file: Path, model: str | None, overrides: list[str]) -> tuple[str, ContactModel]:
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    found: dict[str, ContactModel] = build_parts(source, "model")
    if model is None and len(found) == 1:
        model = next(iter(found))
    if model is None or model not in found:
        wanted = f"there is no [model.{model}]{suggest(model, found)}" if model else "name one of its models by --model"
        known = "" if model else f" (there are: {', '.join(sorted(found)) or 'none'})"
        raise ConfigurationError(f"{file}: {wanted}{known}")
    return model, found[model]


def _theta(model: ContactModel, assignments: list[str]) -> list[float]:
    """Parameter values; where one is not given, the model's own first guess, with a notice."""
    given: dict[str, str] = {}
    names = [parameter.name for parameter in model.parameters]
    for assignment in assignments:
        name, equals, value = assignment.partition("=")
        if not equals or name not in names:
            raise ConfigurationError(f"--parameter {assignment}: write NAME=VALUE{suggest(name, names)}")
        given[name] = value.strip().strip("\"'")
    theta = []
    for parameter in model.parameters:
        if parameter.name not in given:
            if parameter.start is None:
                raise ConfigurationError(f"--parameter {parameter.name}=... is missing; it is in {parameter.unit}")
            typer.echo(
                f"palpate model force: {parameter.name} not given: {parameter.start:g} {parameter.unit}", err=True
            )
            theta.append(parameter.start)
            continue
        number = _si(f"--parameter {parameter.name}", given[parameter.name], parameter.unit)
        if not parameter.lower <= number <= parameter.upper:
            limits = f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
            raise ConfigurationError(f"--parameter {parameter.name}={given[parameter.name]}: allowed is {limits}")
        theta.append(number)
    return theta


def _si(option: str, text: str, unit: str) -> float:
    try:
        return to_si(float(text) if is_number(text) else text, unit)
    except ValueError as error:
        raise ConfigurationError(f"{option}: {error}") from error


def _positive(option: str, text: str, unit: str) -> float:
    value = _si(option, text, unit)
    if value <= 0:
        raise ConfigurationError(f"{option}: {text!r} must be more than 0")
    return value


def _ramp(depth: str, speed: str) -> tuple[Floats, Floats, Floats]:
    deepest, rate = _positive("--depth", depth, "m"), _positive("--speed", speed, "m/s")
    fraction = np.linspace(0.0, 1.0, _SAMPLES)
    return fraction * deepest / rate, fraction * deepest, np.full(_SAMPLES, rate)


def _sine(depth: str, amplitude: str, frequency: str, cycles: int) -> tuple[Floats, Floats, Floats]:
    mean, swing = _positive("--depth", depth, "m"), _positive("--amplitude", amplitude, "m")
    omega = 2 * np.pi * _positive("--frequency", frequency, "Hz")
    period = 2 * np.pi / omega
    time = np.linspace(0.0, (cycles + 1) * period, (cycles + 1) * 200 + 1)
    depths, rates = mean + swing * np.sin(omega * time), swing * omega * np.cos(omega * time)
    # The first cycle fades in, so that a material that relaxes has been pressed from rest.
    begun = np.minimum(time / period, 1.0)
    fade, growth = np.sin(np.pi / 2 * begun) ** 2, np.where(begun < 1, np.pi / 2 / period * np.sin(np.pi * begun), 0.0)
    return time, depths * fade, rates * fade + depths * growth


def _write(curve: _ForceCurve, out: Path | None) -> None:
    try:
        opened = out.open("w", newline="", encoding="utf-8") if out else nullcontext(sys.stdout)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    with opened as stream:
        _write_rows(curve, stream)


def _write_rows(curve: _ForceCurve, stream: IO[str]) -> None:
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["time [s]", "depth [m]", "rate [m/s]", "force [N]"])
    for row in zip(curve.time, curve.depth, curve.rate, curve.force, strict=True):
        writer.writerow([f"{value:.9g}" for value in row])


@style()
def _draw(curve: _ForceCurve, model: ContactModel, name: str, picture: Path) -> None:
    """Force over depth, force over time, and the tip where the model has one."""
    tip = getattr(model, "indenter", None)
    figure, panels = figure_of(3 if tip is not None else 2)
    axes = panels[0]
    axes[0].plot(1e3 * curve.depth, curve.force)
    axes[0].set(xlabel="depth d [mm]", ylabel="force F [N]", title=name)
    axes[1].plot(curve.time, curve.force)
    axes[1].set(xlabel="time [s]", ylabel="force F [N]")
    if tip is not None:
        draw_tip(axes[2], tip, float(np.max(curve.depth)))
        known = registries.load().parts["indenter"].items()
        axes[2].set_title(next((word for word, entry in known if entry.part is type(tip)), "tip"))
    save_figure(figure, picture)


def draw_tip(axis: Any, tip: Any, depth: float) -> None:
    """A tip's profile out to its contact radius at a depth [m], with the surface it has reached there."""
    radii, heights = tip_profile(tip, depth)
    for side in (-1, 1):
        axis.plot(side * 1e3 * radii, 1e3 * heights, color="black")
    axis.axhline(1e3 * depth, linestyle=":", color="gray")
    axis.set(xlabel="r [mm]", ylabel="z [mm]", aspect="equal")
