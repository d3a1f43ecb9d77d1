"""``palpate material master``: one curve of sweeps at several temperatures, its shifts, and laws of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from palpate import ConfigurationError, printable
from palpate_engine import make_folder, write_new
from palpate_kit.terminal.json_output import json_text, print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption
from palpate_kit.terminal.quantities import unsigned, value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_reference.material_table import MaterialTable, frequency_or_time, letters
from palpate_reference.superposition.master_curve import MasterCurve, master_curve
from palpate_reference.superposition.shift_laws import ShiftLaw, shift_laws
from palpate_reference.superposition.temperature_sweeps import temperature_of, temperature_sweeps
from palpate_reference.table_options import ColumnOption, ModulusOption, UnitOption, table_settings
from palpate_reference.table_reader import read_tables

_REFUTED = 1e-3  # p, a choice: one true law in a thousand is refuted by chance
_MAX_REFERENCE_DISTANCE = 2.0  # [K], a choice: of the reference from the temperature of a sweep
ReferenceOption = Annotated[
    str | None, typer.Option("--reference-temperature", metavar="TEMPERATURE", help="Of the master curve: '25 °C'.")
]
VerticalOption = Annotated[bool, typer.Option("--vertical", help="Shift moduli, too (b_T); needs G'' or a curved G'.")]

ByOption = Annotated[
    Literal["moduli", "storage"],
    typer.Option(help="What is laid on one another: both moduli, or G' where the loss is that of the instrument."),
]


def master(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Tables of sweeps at several temperatures.")],
    reference: ReferenceOption = None,
    vertical: VerticalOption = False,
    by: ByOption = "moduli",
    units: UnitOption = None,
    modulus: ModulusOption = None,
    columns: ColumnOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Shift sweeps at several temperatures onto one curve, with the uncertainty of each shift.

    The curve presumes no law. WLF and Arrhenius are fitted to the shifts. Sweeps that do not superpose are named.
    Writes master.csv, shifts.json and master.png; `palpate material fit --reference-temperature` fits laws to it.
    """
    settings = table_settings(units, modulus, columns)
    tables = [table for path in files for table in read_tables(path, settings) if table.kind != "stress-strain"]
    curve = curve_at(tables, reference, vertical, by == "storage")
    laws = shift_laws(curve)
    folder = make_folder("master", out, datetime.now(UTC).astimezone())
    write_new(folder / "master.csv", csv_of(curve))
    write_new(folder / "shifts.json", json_text(document(curve, laws)))
    from palpate_reference.superposition.master_figure import draw_master_curve

    draw_master_curve(curve, laws, folder / "master.png")
    if as_json:
        print_json({"folder": folder, **document(curve, laws)})
        return
    with print_aside(False):
        _show(curve, laws)
    typer.echo(f"written to {folder}: master.csv, shifts.json, master.png", err=layout != "table")


def curve_at(
    tables: Sequence[MaterialTable], reference: str | None, vertical: bool, storage: bool = False
) -> MasterCurve:
    """Return the master curve at a reference temperature as a person writes it, else at the middle one.

    By both moduli, or by `storage` alone. Raises ConfigurationError without a sweep at the reference.
    """
    requested = None if reference is None else temperature_of(reference)
    if not tables:
        raise ConfigurationError("no table holds a modulus over frequency or time")
    sweeps = temperature_sweeps(tables)
    temperatures = np.array([sweep.temperature for sweep in sweeps])
    index = (len(sweeps) - 1) // 2 if requested is None else int(np.argmin(np.abs(temperatures - requested)))
    if requested is not None and abs(temperatures[index] - requested) > _MAX_REFERENCE_DISTANCE:
        raise ConfigurationError(
            f"--reference-temperature {reference!r}: no sweep is at it; there are sweeps at "
            f"{', '.join(f'{temperature:.1f}' for temperature in temperatures)} °C"
        )
    return master_curve(sweeps, index, vertical, storage)


def csv_of(curve: MasterCurve) -> str:
    """Return the readings as at the reference temperature, with the temperature that they were measured at."""
    table = curve.table()
    unit = "1/Pa" if table.kind == "creep" else "Pa"
    axis = f"{'frequency' if table.kind == 'oscillation' else 'time'} [{frequency_or_time(table.kind)}]"
    assert table.temperature is not None
    comment = f"# {table.title}; a_T and their uncertainty are in shifts.json"
    headings = [axis, *(f"{name} [{unit}]" for name in letters(table)), "measured at [°C]"]
    numbers = np.column_stack([table.x, table.y, table.temperature])
    rows = [",".join(f"{value:.7g}" for value in row) for row in numbers]
    return "\n".join([comment, ",".join(headings), *rows]) + "\n"


def _show(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> None:
    """Print the shifts, their laws, and what is doubtful."""
    screen = console()
    screen.print(shift_table(curve).view(), highlight=False)
    if laws:
        screen.print(law_table(laws).view(), highlight=False)
    for line in superposition_remarks(curve, laws):
        screen.print(printable(line), style="yellow", highlight=False)


def shift_table(curve: MasterCurve) -> Table:
    """Return one row for each temperature: log10 a_T, b_T, and the residuals of the sweep."""
    rows = []
    for k, (sweep, (ln_a, ln_b), (ln_a_std, ln_b_std)) in enumerate(
        zip(curve.sweeps, curve.shifts, curve.stds, strict=True)
    ):
        shift = "reference"
        if k != curve.reference:
            shift = value_with_uncertainty(ln_a / math.log(10), ln_a_std / math.log(10))
        b_text = value_with_uncertainty(math.exp(ln_b), math.exp(ln_b) * ln_b_std) if curve.vertical else ""
        own_scatter = curve.own_scatter[k]
        rows.append(
            (
                unsigned(f"{sweep.temperature:.1f}"),
                str(sum(len(table.x) for table in sweep.tables)),
                shift,
                b_text,
                f"{100 * curve.scatter[k]:.2g}",
                f"{100 * own_scatter:.2g}" if math.isfinite(own_scatter) else "",
            )
        )
    headings = ("T\n°C", "rows", "log10 a_T", "b_T", "residual\n%", "by itself\n%")
    return Table.of(f"master curve at {curve.temperatures[curve.reference]:.1f} °C", headings, rows, ("T\n°C",))


def law_table(laws: Sequence[ShiftLaw]) -> Table:
    """Return the laws of the shift, the better first."""
    rows = []
    for law in laws:
        constants = ", ".join(_constant_text(name, *constant) for name, constant in law.values.items())
        rows.append((law.name, constants, f"{law.deviation:.2g}", f"{law.chi2:.3g} / {law.freedom}"))
    return Table.of("laws of the shift", ("law", "values", "rms of\nlog10 a_T", "chi^2 / freedom"), rows, ("law",))


def _constant_text(name: str, value: float, std: float, unit: str) -> str:
    """Return a constant of a law with its uncertainty, energies in kJ/mol."""
    factor, shown_unit = (1e-3, "kJ/mol") if unit == "J/mol" else (1.0, unit)
    return f"{name} {value_with_uncertainty(factor * value, factor * std)} {'' if unit == '1' else shown_unit}".strip()


def superposition_remarks(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> list[str]:
    """Return sentences on what is doubtful: sweeps that do not superpose, and shifts that no law describes."""
    doubts = []
    if curve.strange:
        temperatures = ", ".join(f"{curve.sweeps[k].temperature:.1f}" for k in curve.strange)
        hint = "; --vertical shifts the moduli, too, --by storage leaves the loss out of account"
        doubts.append(
            f"sweeps at {temperatures} °C do not superpose: they miss the common curve by more than they scatter, so "
            f"that their shifts are doubtful{'' if curve.vertical else hint}"
        )
    if laws and all(law.p < _REFUTED for law in laws):
        doubts.append(
            "no law describes the shifts within their uncertainties: do not go beyond the temperatures measured"
        )
    return doubts


def document(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> dict[str, Any]:
    """Return a master curve and the laws of its shifts as plain data [SI, °C]."""
    return {
        "reference_temperature": float(curve.temperatures[curve.reference]),
        "vertical": curve.vertical,
        "sweeps": [_sweep_document(curve, k) for k in range(len(curve.sweeps))],
        "covariance": curve.covariance.tolist(),
        "laws": [_law_document(law) for law in laws],
        "remarks": superposition_remarks(curve, laws),
    }


def _sweep_document(curve: MasterCurve, index: int) -> dict[str, Any]:
    """Return one sweep of a master curve with its shifts."""
    sweep = curve.sweeps[index]
    return {
        "temperature": sweep.temperature,
        "sources": [table.name for table in sweep.tables],
        "ln_a": float(curve.shifts[index, 0]),
        "ln_a_std": float(curve.stds[index, 0]),
        "ln_b": float(curve.shifts[index, 1]),
        "ln_b_std": float(curve.stds[index, 1]),
        "residual": float(curve.scatter[index]),
        "own_residual": float(curve.own_scatter[index]),
    }


def _law_document(law: ShiftLaw) -> dict[str, Any]:
    """Return a law of the shifts with its constants."""
    parameters = {name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in law.values.items()}
    return {
        "law": law.name,
        "formula": law.formula,
        "chi2": law.chi2,
        "freedom": law.freedom,
        "p": law.p,
        "deviation": law.deviation,
        "parameters": parameters,
    }
