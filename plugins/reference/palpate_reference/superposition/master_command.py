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

_REFUTED = 1e-3  # p of a law
_APART = 2.0  # [K] by which the reference may miss the temperature of a sweep
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
    """The master curve at the temperature that is asked for, else at the middle one; raises ConfigurationError."""
    wanted = None if reference is None else temperature_of(reference)
    if not tables:
        raise ConfigurationError("no table holds a modulus over frequency or time")
    sweeps = temperature_sweeps(tables)
    there = np.array([sweep.temperature for sweep in sweeps])
    at = (len(sweeps) - 1) // 2 if wanted is None else int(np.argmin(np.abs(there - wanted)))
    if wanted is not None and abs(there[at] - wanted) > _APART:
        raise ConfigurationError(
            f"--reference-temperature {reference!r}: no sweep is at it; there are sweeps at "
            f"{', '.join(f'{one:.1f}' for one in there)} °C"
        )
    return master_curve(sweeps, at, vertical, storage)


def csv_of(curve: MasterCurve) -> str:
    """The readings as at the reference temperature, with the temperature that they were measured at."""
    table = curve.table()
    per = "1/Pa" if table.kind == "creep" else "Pa"
    axis = f"{'frequency' if table.kind == 'oscillation' else 'time'} [{frequency_or_time(table.kind)}]"
    assert table.temperature is not None
    lines = [f"# {table.title}; a_T and their uncertainty are in shifts.json"]
    lines += [",".join([axis, *(f"{name} [{per}]" for name in letters(table)), "measured at [°C]"])]
    rows = np.column_stack([table.x, table.y, table.temperature])
    return "\n".join([*lines, *(",".join(f"{value:.7g}" for value in row) for row in rows)]) + "\n"


def _show(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> None:
    screen = console()
    screen.print(shift_table(curve).view(), highlight=False)
    if laws:
        screen.print(law_table(laws).view(), highlight=False)
    for line in superposition_remarks(curve, laws):
        screen.print(printable(line), style="yellow", highlight=False)


def shift_table(curve: MasterCurve) -> Table:
    """One row for each temperature."""
    rows = []
    for k, (sweep, (a, b), (u_a, u_b)) in enumerate(zip(curve.sweeps, curve.shifts, curve.stds, strict=True)):
        shift = "reference" if k == curve.reference else value_with_uncertainty(a / math.log(10), u_a / math.log(10))
        up = value_with_uncertainty(math.exp(b), math.exp(b) * u_b) if curve.vertical else ""
        count = str(sum(len(table.x) for table in sweep.tables))
        rows.append((unsigned(f"{sweep.temperature:.1f}"), count, shift, up, f"{100 * curve.scatter[k]:.2g}",
                     f"{100 * curve.own_scatter[k]:.2g}" if math.isfinite(curve.own_scatter[k]) else ""))  # fmt: skip
    heads = ("T\n°C", "rows", "log10 a_T", "b_T", "residual\n%", "by itself\n%")
    return Table.of(f"master curve at {curve.temperatures[curve.reference]:.1f} °C", heads, rows, ("T\n°C",))


def law_table(laws: Sequence[ShiftLaw]) -> Table:
    """Laws of the shift, the better first."""
    rows = []
    for law in laws:
        factor = {"J/mol": (1e-3, "kJ/mol")}
        words = []
        for name, (value, std, unit) in law.values.items():
            scale, word = factor.get(unit, (1.0, unit))
            words.append(
                f"{name} {value_with_uncertainty(scale * value, scale * std)} {'' if word == '1' else word}".strip()
            )
        rows.append((law.name, ", ".join(words), f"{law.deviation:.2g}", f"{law.chi2:.3g} / {law.freedom}"))
    return Table.of("laws of the shift", ("law", "values", "rms of\nlog10 a_T", "chi^2 / freedom"), rows, ("law",))


def superposition_remarks(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> list[str]:
    """What is to be doubted."""
    doubts = []
    if curve.strange:
        at = ", ".join(f"{curve.sweeps[k].temperature:.1f}" for k in curve.strange)
        hint = (
            "" if curve.vertical else "; --vertical shifts the moduli, too, --by storage leaves the loss out of account"
        )
        doubts.append(
            f"sweeps at {at} °C do not superpose: they miss the common curve by more than they scatter, so that their "
            f"shifts are doubtful{hint}"
        )
    if laws and all(law.p < _REFUTED for law in laws):
        doubts.append(
            "no law describes the shifts within their uncertainties: do not go beyond the temperatures measured"
        )
    return doubts


def document(curve: MasterCurve, laws: Sequence[ShiftLaw]) -> dict[str, Any]:
    """Everything as plain data [SI, °C]."""
    return {
        "reference_temperature": float(curve.temperatures[curve.reference]), "vertical": curve.vertical,
        "sweeps": [
            {
                "temperature": sweep.temperature, "sources": [table.name for table in sweep.tables],
                "ln_a": float(curve.shifts[k, 0]), "ln_a_std": float(curve.stds[k, 0]),
                "ln_b": float(curve.shifts[k, 1]), "ln_b_std": float(curve.stds[k, 1]),
                "residual": float(curve.scatter[k]), "own_residual": float(curve.own_scatter[k]),
            }
            for k, sweep in enumerate(curve.sweeps)
        ],
        "covariance": curve.covariance.tolist(),
        "laws": [
            {
                "law": law.name, "formula": law.formula, "chi2": law.chi2, "freedom": law.freedom, "p": law.p,
                "deviation": law.deviation,
                "parameters": {name: {"value": value, "std": std, "unit": unit}
                               for name, (value, std, unit) in law.values.items()},
            }
            for law in laws
        ],
        "remarks": superposition_remarks(curve, laws),
    }  # fmt: skip
