"""``palpate calibrate``: mass, timing, tare and noise of a rig, into a small file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.quantities import measured
from palpate.cli.tables import drawing
from palpate.config import load_plan
from palpate.errors import OutputError

if TYPE_CHECKING:
    from palpate.calibration import Calibration

# SI unit -> what people write, and how many of it one SI unit is.
_PEOPLE = {
    "kg": ("g", 1e3),
    "s": ("ms", 1e3),
    "m": ("µm", 1e6),
    "m/s": ("mm/s", 1e3),
    "N/s": ("mN/s", 1e3),
    "m/N": ("µm/N", 1e6),
}
_MEANING = {
    "mass": "mass behind the sensor",
    "delay": "force later than position",
    "velocity_delay": "velocity later than position",
    "offset": "reading at rest",
    "weight": "mass times gravity",
    "bias": "reading at rest without the weight",
    "drift": "of the reading at rest",
    "force_std": "noise of one force reading",
    "position_std": "noise of one position",
    "velocity_std": "noise of one velocity, at rest",
    "tap_delay": "force later than position, on a plate",
    "compliance": "of robot and sensor, with that of the plate",
    "paper_velocity_std": "RMSE to the 21-sample mean, shaken",
}


def calibrate(
    file: Annotated[Path, typer.Argument(help="A pipeline file, or one with devices and [alignment] only.")],
    out: Annotated[
        Path | None, typer.Option(help="The calibration file; must be new. [default: FILE.calibration.toml]")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Override a setting; can be repeated.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw force and inertia into this file (.png, .svg or .pdf; wants matplotlib).")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over an older calibration file.")] = False,
) -> None:
    """Calibrate mass, force-motion delay, tare and noise from a shake in free air; write them with uncertainties.

    The tip must hang free. A robot rests, shakes the tip up and down, and rests; three times unless told otherwise.
    A recorded log of such a motion does as well.
    """
    from rich.console import Console

    from palpate.pipeline import run_calibration

    target = out if out is not None else file.with_suffix(".calibration.toml")
    plan = load_plan(file, overrides or [])
    if target.exists() and not force:
        raise OutputError(f"{target}: exists already; --force writes over it, --out writes elsewhere")
    errors, console = Console(stderr=True), Console()
    calibration, session, records = run_calibration(plan, lambda text: errors.print(text, highlight=False))
    try:
        target.write_text(calibration.text(), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{target}: cannot write: {error.strerror}") from error
    if not console.is_terminal:
        console = Console(width=120)
    console.print(_table(calibration))
    for line in _lines(calibration, target):
        console.print(line, highlight=False, markup=False)
    if picture is not None and session.shakes:
        from palpate.cli.calibrate_picture import draw

        with drawing(picture):
            draw(records[0], session, plan.settings.settle, picture)


def _table(calibration: Calibration) -> object:
    from rich.table import Table

    table = Table(title=calibration.name, title_justify="left")
    for heading in ("", "value", "95 % interval", "unit", "fit", "repeats", "type B"):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right")
    for name, value in calibration.values.items():
        unit, scale = _PEOPLE.get(value.unit, (value.unit, 1.0))
        low, high = (f"{edge * scale:.5g}" for edge in value.interval)
        scatter = "" if value.type_a is None else f"{value.type_a * scale:.2g}"
        table.add_row(
            f"{name}: {_MEANING.get(name, '')}",
            measured(value.value * scale, value.std * scale),
            f"{low} to {high}",
            unit,
            f"{value.fit * scale:.2g}",
            scatter,
            f"{value.type_b * scale:.2g}" if value.type_b else "",
        )
    return table


def _lines(calibration: Calibration, target: Path) -> Iterator[str]:
    shake = calibration.shake
    if shake:
        yield _shaken(shake)
    yield from calibration.notes
    yield f'written to {target}; a pipeline takes it by [run] calibration = "{target.name}"'


def _shaken(shake: Mapping[str, Any]) -> str:
    sines = ", ".join(
        f"{f:.3g} Hz {a * 1e3:.3g} mm" for f, a in zip(shake["frequencies"], shake["amplitudes"], strict=True)
    )
    return f"{shake['count']} shakes of {sines}; residual {shake['residual']:.3g} N"
