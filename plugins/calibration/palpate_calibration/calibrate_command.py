"""``palpate calibrate``: mass, timing, tare and noise of a rig, into the file of facts of the rig."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, OutputError
from palpate_engine import RIG, read_rig, write_whole
from palpate_kit.runs.rig_file import write_rig
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption, Overrides
from palpate_kit.terminal.quantities import round_number, value_with_uncertainty
from palpate_kit.terminal.table import console

from palpate_calibration.plan import load_plan

if TYPE_CHECKING:
    from palpate_kit.runs.calibration_file import Calibration

    from palpate_calibration.guided_calibration import Guide
    from palpate_calibration.protocol import StepFindings

_WIDTH = 120  # characters of a line of the table: a choice
# SI unit -> the unit on the screen, and how many of it one SI unit is.
_DISPLAY_UNITS = {
    "kg": ("g", 1e3),
    "s": ("ms", 1e3),
    "m": ("µm", 1e6),
    "N*m": ("mN m", 1e3),
    "m/s": ("mm/s", 1e3),
    "N/s": ("mN/s", 1e3),
    "m/N": ("µm/N", 1e6),
}
_MEANINGS = {
    "mass": "mass behind the sensor",
    "delay": "force later than position",
    "velocity_delay": "velocity later than position",
    "offset": "reading at standstill",
    "weight": "mass times gravity",
    "bias": "reading at standstill without the weight",
    "drift": "of the reading at standstill",
    "force_std": "noise of one force reading",
    "position_std": "noise of one position",
    "velocity_std": "noise of one velocity, at standstill",
    "tap_delay": "force later than position, on a plate",
    "compliance": "of robot and sensor, with that of the plate",
    "mass_by_weight": "mass behind the sensor, from its weight",
    "centre_x": "centre of that mass, in the sensor's frame",
    "centre_y": "the same",
    "centre_z": "the same",
    "mounting_x": "rotation vector of the sensor on the tool",
    "mounting_y": "the same",
    "mounting_z": "the same",
    "bias_x": "reading without the weight",
    "bias_y": "the same",
    "bias_z": "the same",
    "torque_bias_x": "the same",
    "torque_bias_y": "the same",
    "torque_bias_z": "the same",
    "moving_velocity_std": "noise of one velocity, while moving",
    "paper_velocity_std": "RMSE to the 21-sample mean, while moving",
}


def calibrate(
    file: Annotated[Path, typer.Argument(help="A pipeline file, or one with devices and [alignment] only.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="File of facts that takes it. [default: rig.toml next to FILE]"),
    ] = None,
    overrides: Overrides = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw force and inertia into this file (.png, .svg or .pdf).")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what an older calibration has measured.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: the rig has been prepared.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Calibrate mass, force-motion delay, tare and noise from a shake in free air; write them with uncertainties.

    The tip must hang free. A robot stands still, shakes the tip up and down, and stands still; three times by default.
    A recorded log of such a motion works as well. [calibration.standstill], orientations, shake, noise, tap
    and press are steps that are done one after the other, each with what it found.
    """
    from palpate_calibration.guided_calibration import run_calibration

    target = out if out is not None else file.with_name(RIG)
    plan = load_plan(file, overrides or [])
    _refuse_target(target, force)
    # Each step is kept in a part file, until the whole is written with the command that made it.
    part = target.with_suffix(".part.toml")
    calibration, findings, records = run_calibration(plan, _guide(part, yes))
    options = [word for assignment in overrides or () for word in ("--set", assignment)]
    command = shlex.join(["palpate", "calibrate", str(file), *options])
    write_rig(target, calibration.model_copy(update={"command": command}).tables())
    part.unlink(missing_ok=True)
    with print_aside(as_json):
        _print_calibration(calibration, target, file, with_table=not as_json)
    if as_json:
        print_json({"file": target, **calibration.model_dump(mode="json")})
    if picture is not None and findings.shakes:
        from palpate_calibration.shake_figure import draw

        draw(records[0], findings, plan.settings.settle, picture)


def _print_calibration(calibration: Calibration, target: Path, file: Path, with_table: bool) -> None:
    """Print the table of values, where it is requested, then the notes and the place of the file."""
    terminal = console(_WIDTH)
    if with_table:
        terminal.print(_table(calibration))
    for line in _lines(calibration, target, file):
        terminal.print(line, highlight=False, markup=False, soft_wrap=True)


def _guide(part: Path, yes: bool) -> Guide:
    """Return the guide that writes to the terminal, and keeps the results of each step in a file."""
    from rich.console import Console

    from palpate_calibration.guided_calibration import Guide

    errors = Console(stderr=True, markup=False, emoji=False)

    def say(text: str) -> None:
        errors.print(text, highlight=False, markup=False, soft_wrap=True)

    def show(step: str, findings: StepFindings) -> None:
        for line in _value_lines(findings):
            say(line)

    def keep(calibration: Calibration) -> None:
        write_whole(part, calibration.text())
        say(f"  kept in {part}")

    return Guide(say, _ask(say, yes), show, keep)


def _refuse_target(target: Path, force: bool) -> None:
    """Raise OutputError where the file cannot be written, before anybody has spent time at the rig."""
    if target.exists() and read_rig(target).measured and not force:
        raise OutputError(f"{target}: holds a calibration already; --force replaces it, --out writes elsewhere")
    if not target.parent.is_dir():
        raise OutputError(f"{target}: no folder {target.parent}")


def _ask(say: Callable[[str], None], yes: bool) -> Callable[[str], None]:
    """Return the function that asks the person at the rig, and waits; with `yes` it only says the text."""

    def ask(text: str) -> None:
        if yes:
            say(text)
            return
        try:
            typer.prompt(f"{text}; then press Enter", default="", show_default=False, prompt_suffix=" ", err=True)
        except (EOFError, typer.Abort) as error:
            raise ConfigurationError("no answer; --yes continues without asking") from error

    return ask


def _value_lines(findings: StepFindings) -> Iterator[str]:
    """Yield the results of a step, a line for each value."""
    for name, value in findings.values.items():
        unit, scale = _DISPLAY_UNITS.get(value.unit, (value.unit, 1.0))
        text = value_with_uncertainty(value.value * scale, value.combined * scale)
        yield f"  {name}: {text} {unit}  ({_MEANINGS.get(name, '')})"
    for note in findings.notes:
        yield f"  {note}"


def _table(calibration: Calibration) -> object:
    """Return the table of values with their uncertainties, by where these come from."""
    from rich.table import Table

    # Type A is the scatter of the repeats, type B what is stated of the rig.
    table = Table(title=calibration.name, title_justify="left")
    for heading in ("", "value", "95 % interval", "unit", "fit", "repeats", "type B"):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right")
    for name, value in calibration.values.items():
        unit, scale = _DISPLAY_UNITS.get(value.unit, (value.unit, 1.0))
        low, high = (round_number(edge * scale) for edge in value.interval)
        scatter = "" if value.type_a is None else f"{value.type_a * scale:.2g}"
        table.add_row(
            f"{name}: {_MEANINGS.get(name, '')}",
            value_with_uncertainty(value.value * scale, value.std * scale),
            f"{low} to {high}",
            unit,
            f"{value.fit * scale:.2g}",
            scatter,
            f"{value.type_b * scale:.2g}" if value.type_b else "",
        )
    return table


def _lines(calibration: Calibration, target: Path, file: Path) -> Iterator[str]:
    shake = calibration.shake
    if shake:
        yield _shake_text(shake)
    yield from calibration.notes
    reference = target.name if target.resolve().parent == file.resolve().parent else target.resolve()
    yield f'written to {target}; a pipeline takes it by [run] rig = "{reference}"'


def _shake_text(shake: Mapping[str, Any]) -> str:
    sines = ", ".join(
        f"{f:.3g} Hz {a * 1e3:.3g} mm" for f, a in zip(shake["frequencies"], shake["amplitudes"], strict=True)
    )
    return f"{shake['count']} shakes of {sines}; residual {shake['residual']:.3g} N"
