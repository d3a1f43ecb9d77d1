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

from palpate_spectra.command_options import SurfaceOption, parse_height
from palpate_spectra.recorded_oscillation import replay
from palpate_spectra.transient.recorded_press import longest_press
from palpate_spectra.transient.relaxation_figure import draw
from palpate_spectra.transient.relaxation_modulus import ModulusCurve, modulus_curve
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
    curve = modulus_curve(longest_press(replay(run, track), str(run)), parse_height(surface))
    flags = list(dict.fromkeys(flags_of(curve)))
    folder = make_folder("creep" if curve.creeps else "relaxation", out, datetime.now(UTC).astimezone())
    curve_file, spectrum_file = (
        ("compliance.csv", "retardation.csv") if curve.creeps else ("modulus.csv", "relaxation.csv")
    )
    write_new(folder / curve_file, _csv_text(*_curve_rows(curve)))
    write_new(folder / spectrum_file, _csv_text(*_spectrum_rows(curve)))
    draw(curve, folder / "relaxation.png")
    if as_json:
        print_json({"folder": folder, **document(curve), "flags": [flag.table() for flag in flags]})
        return
    with print_aside(False):
        _print_curve(curve, flags)
    typer.echo(f"written to {folder}: {curve_file}, {spectrum_file}, relaxation.png", err=layout != "table")


def _print_curve(curve: ModulusCurve, flags: Sequence[Flag]) -> None:
    """Print the curve, its decades of times and its flags for a person."""
    screen = console()
    screen.print(curve_table(curve).view(), highlight=False)
    screen.print(decade_table(curve).view(), highlight=False)
    screen.print(summary_sentence(curve), highlight=False)
    for flag in flags:
        screen.print(str(flag), style="yellow", markup=False, highlight=False)


def _display_unit(curve: ModulusCurve) -> tuple[float, str, str]:
    """Return the factor from SI, the unit and the letter in which people read the curve."""
    return (1e6, "1/MPa", "J") if curve.creeps else (1e-3, "kPa", "E")


def curve_table(curve: ModulusCurve) -> Table:
    """Return the curve with its uncertainty, that of the noise alone, and the ramp's correction; of a creep with E."""
    factor, unit, letter = _display_unit(curve)
    headings = ["t\ns", f"{letter}(t)\n{unit}", f"noise\n{unit}", "ramp\n%"]
    columns = (curve.time, curve.value, curve.std, curve.noise, curve.correction)
    rows = [
        [
            f"{time:.3g}",
            value_with_uncertainty(factor * value, factor * std),
            f"{factor * noise:.2g}",
            f"{100 * (correction - 1):+.2g}",
        ]
        for time, value, std, noise, correction in _rows_of(columns)
    ]
    if curve.creeps:
        headings.append("E(t)\nkPa")
        for row, (modulus, std) in zip(rows, _rows_of(curve.modulus), strict=True):
            row.append(value_with_uncertainty(1e-3 * modulus, 1e-3 * std))
    return Table.of(f"held at {_held_text(curve)}", headings, rows, [])


def _held_text(curve: ModulusCurve) -> str:
    """Return the mean force, or depth, of the longest hold in words."""
    press, rows = curve.press, curve.press.longest_hold.rows
    if curve.creeps:
        return f"a force of {press.force[rows].mean():.3g} N"
    depth = press.depth(curve.rig.surface, curve.rig.compliance)[rows]
    return f"a depth of {1e3 * depth.mean():.3g} mm"


def decade_table(curve: ModulusCurve) -> Table:
    """Return the strengths of the spectrum by decades of time."""
    factor, unit, _ = _display_unit(curve)
    rows = [
        [
            f"{decade.low:.2g} to {decade.high:.2g}",
            value_with_uncertainty(factor * decade.strength, factor * decade.std),
        ]
        for decade in decades(curve)
    ]
    process = "retardation" if curve.creeps else "relaxation"
    return Table.of(f"spectrum of {process} times", ["times\ns", f"strength\n{unit}"], rows, [])


def summary_sentence(curve: ModulusCurve) -> str:
    """Return the first and the last point of the curve, and the height of the skin, in words."""
    factor, unit, letter = _display_unit(curve)
    values, stds = (factor * curve.value).tolist(), (factor * curve.std).tolist()
    first, last = (f"{value_with_uncertainty(values[i], stds[i])} {unit} at {curve.time[i]:.3g} s" for i in (0, -1))
    skin = value_with_uncertainty(1e3 * curve.rig.surface, 1e3 * curve.surface_std)
    return f"{letter}(t) goes from {first} to {last}; the skin is at {skin} mm."


def _rows_of(columns: Sequence[Floats]) -> list[tuple[float, ...]]:
    """Return the rows of columns (m,)."""
    return list(zip(*(column.tolist() for column in columns), strict=True))


def _curve_rows(curve: ModulusCurve) -> tuple[list[str], list[tuple[float, ...]]]:
    """Return headings and rows of the curve [SI]; of a creep with E."""
    name, unit = ("J", "per_Pa") if curve.creeps else ("E", "Pa")
    headings = ["time_s", f"{name}_{unit}", f"{name}_std_{unit}", f"{name}_noise_std_{unit}", "ramp_correction"]
    columns: tuple[Floats, ...] = (curve.time, curve.value, curve.std, curve.noise, curve.correction)
    if curve.creeps:
        headings += ["E_Pa", "E_std_Pa"]
        columns += curve.modulus
    return headings, _rows_of(columns)


def _spectrum_rows(curve: ModulusCurve) -> tuple[list[str], list[tuple[float, ...]]]:
    """Return headings and rows of the spectrum of times [SI]."""
    name, unit = ("L", "per_Pa") if curve.creeps else ("H", "Pa")
    return ["time_s", f"{name}_{unit}", f"{name}_std_{unit}"], _rows_of(density(curve))


def _csv_text(headings: Sequence[str], rows: Sequence[Sequence[float]]) -> str:
    """Return a table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows([f"{value:.10g}" for value in row] for row in rows)
    return text.getvalue()


def document(curve: ModulusCurve) -> dict[str, Any]:
    """Return the curve, its spectrum and its uncertainties as plain data [SI]."""
    curve_headings, curve_rows = _curve_rows(curve)
    spectrum_headings, spectrum_rows = _spectrum_rows(curve)
    return {
        "held": "force" if curve.creeps else "depth",
        "curve": [dict(zip(curve_headings, row, strict=True)) for row in curve_rows],
        "spectrum": [dict(zip(spectrum_headings, row, strict=True)) for row in spectrum_rows],
        "decades": [vars(decade) for decade in decades(curve)],
        "sources": {source: shift.tolist() for source, shift in curve.shifts.items()},
        "surface": {"value": curve.rig.surface, "std": curve.surface_std},
        "chi2": curve.relaxation_fit.chi2,
        "freedom": curve.relaxation_fit.freedom,
        "sentence": summary_sentence(curve),
    }
