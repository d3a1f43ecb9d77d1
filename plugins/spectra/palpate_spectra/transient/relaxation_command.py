"""``palpate fit relaxation``: E(t) from a held depth or J(t) from a held force, and the spectrum of times."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import Flag, Floats
from palpate_engine import make_folder, write_new
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption, TrackOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_spectra.command_options import SurfaceOption, height_of
from palpate_spectra.recorded_oscillation import replay
from palpate_spectra.transient.recorded_press import longest_press
from palpate_spectra.transient.relaxation_figure import draw
from palpate_spectra.transient.relaxation_modulus import ModulusCurve, curve
from palpate_spectra.transient.spectrum_of_times import decades, density, flags_of


def relaxation(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder, log or pipeline file of a ramp and a hold.")],
    track: TrackOption = None,
    surface: SurfaceOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Print E(t) of a tip held at a depth, or J(t) of one held at a force; draw it with its spectrum of times.

    Tip, layer and Poisson's ratio are those of the track's model, whose own law of the material plays no part. The ramp
    is taken as it was measured. Which is held, depth or force, is found in the record.
    """
    found = curve(longest_press(replay(run, track), str(run)), height_of(surface))
    flags = list(dict.fromkeys(flags_of(found)))
    folder = make_folder("creep" if found.creeps else "relaxation", out, datetime.now(UTC).astimezone())
    names = ("compliance.csv", "retardation.csv") if found.creeps else ("modulus.csv", "relaxation.csv")
    write_new(folder / names[0], _csv(*_curve_rows(found)))
    write_new(folder / names[1], _csv(*_spectrum_rows(found)))
    draw(found, folder / "relaxation.png")
    if as_json:
        print_json({"folder": folder, **document(found), "flags": [flag.table() for flag in flags]})
        return
    with print_aside(False):
        _show(found, flags)
    typer.echo(f"written to {folder}: {', '.join((*names, 'relaxation.png'))}", err=layout != "table")


def _show(found: ModulusCurve, flags: Sequence[Flag]) -> None:
    screen = console()
    screen.print(curve_table(found).view(), highlight=False)
    screen.print(decade_table(found).view(), highlight=False)
    screen.print(sentence(found), highlight=False)
    for flag in flags:
        screen.print(str(flag), style="yellow", markup=False, highlight=False)


def _unit(found: ModulusCurve) -> tuple[float, str, str]:
    """Factor, unit and letter in which people read the curve."""
    return (1e6, "1/MPa", "J") if found.creeps else (1e-3, "kPa", "E")


def curve_table(found: ModulusCurve) -> Table:
    """The curve with its uncertainty, and that of the noise alone."""
    factor, unit, letter = _unit(found)
    moduli = [
        [value_with_uncertainty(1e-3 * value, 1e-3 * std)]
        for value, std in zip(*(part.tolist() for part in found.modulus))
    ]
    rows = [
        [
            f"{t:.3g}",
            value_with_uncertainty(factor * value, factor * std),
            f"{factor * noise:.2g}",
            f"{100 * (step - 1):+.2g}",
        ]
        for t, value, std, noise, step in zip(
            found.time.tolist(), found.value.tolist(), found.std.tolist(), found.noise.tolist(),
            found.correction.tolist(), strict=True,
        )
    ]  # fmt: skip
    hold = max(found.pressed.holds, key=lambda one: one.end - one.begin)
    depth = found.pressed.depth(found.rig.surface, found.rig.compliance)[hold.rows]
    force = found.pressed.force[hold.rows]
    at = f"a force of {force.mean():.3g} N" if found.creeps else f"a depth of {1e3 * depth.mean():.3g} mm"
    heads = ["t\ns", f"{letter}(t)\n{unit}", f"noise\n{unit}", "ramp\n%"]
    if found.creeps:
        heads, rows = [*heads, "E(t)\nkPa"], [[*row, *more] for row, more in zip(rows, moduli, strict=True)]
    return Table.of(f"held at {at}", heads, rows, [])


def decade_table(found: ModulusCurve) -> Table:
    """What fades, or is delayed, by decades of time."""
    factor, unit, _ = _unit(found)
    rows = [
        [f"{one.low:.2g} to {one.high:.2g}", value_with_uncertainty(factor * one.strength, factor * one.std)]
        for one in decades(found)
    ]
    word = "retardation" if found.creeps else "relaxation"
    return Table.of(f"spectrum of {word} times", ["times\ns", f"strength\n{unit}"], rows, [])


def sentence(found: ModulusCurve) -> str:
    """First and last point in words."""
    factor, unit, letter = _unit(found)
    values, stds = (factor * found.value).tolist(), (factor * found.std).tolist()
    ends = [f"{value_with_uncertainty(values[i], stds[i])} {unit} at {found.time[i]:.3g} s" for i in (0, -1)]
    skin = value_with_uncertainty(1e3 * found.rig.surface, 1e3 * found.surface_std)
    return f"{letter}(t) goes from {ends[0]} to {ends[1]}; the skin is at {skin} mm."


def _curve_rows(found: ModulusCurve) -> tuple[list[str], list[list[float]]]:
    name, unit = ("J", "per_Pa") if found.creeps else ("E", "Pa")
    heads = ["time_s", f"{name}_{unit}", f"{name}_std_{unit}", f"{name}_noise_std_{unit}", "ramp_correction"]
    columns: tuple[Floats, ...] = (found.time, found.value, found.std, found.noise, found.correction)
    if found.creeps:
        heads, columns = [*heads, "E_Pa", "E_std_Pa"], (*columns, *found.modulus)
    return heads, [list(row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def _spectrum_rows(found: ModulusCurve) -> tuple[list[str], list[list[float]]]:
    name, unit = ("L", "per_Pa") if found.creeps else ("H", "Pa")
    columns = density(found)
    heads = ["time_s", f"{name}_{unit}", f"{name}_std_{unit}"]
    return heads, [list(row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def _csv(heads: Sequence[str], rows: Sequence[Sequence[float]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([f"{value:.10g}" for value in row] for row in rows)
    return text.getvalue()


def document(found: ModulusCurve) -> dict[str, Any]:
    """Everything as plain data [SI]."""
    fit = found.tested
    heads, rows = _curve_rows(found)
    heights, spectrum = _spectrum_rows(found)
    return {
        "held": "force" if found.creeps else "depth",
        "curve": [dict(zip(heads, row, strict=True)) for row in rows],
        "spectrum": [dict(zip(heights, row, strict=True)) for row in spectrum],
        "decades": [vars(one) for one in decades(found)],
        "sources": {name: shift.tolist() for name, shift in found.shifts.items()},
        "surface": {"value": found.rig.surface, "std": found.surface_std},
        "chi2": fit.chi2,
        "freedom": fit.freedom,
        "sentence": sentence(found),
    }
