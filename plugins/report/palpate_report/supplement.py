"""The table of a folder of fits for a supplement: a row for each curve, every column with its unit in the header."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from palpate import ConfigurationError, is_number
from palpate_engine import display_unit, is_open, write_whole
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.terminal.layout import text_of
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table
from palpate_kit.terminal.table_file import Column, write_table

from palpate_report.folder_facts import FolderFacts, exclusion_of
from palpate_report.number_texts import readable

SUFFIXES = (".csv", ".tex", ".xlsx")


def write_supplement(facts: FolderFacts, path: Path) -> None:
    """Write the table, as CSV, LaTeX or a workbook by the name; raises ConfigurationError, OutputError."""
    if path.suffix not in SUFFIXES:
        raise ConfigurationError(f"--supplement {path}: a table's name ends in {', '.join(SUFFIXES)}")
    view = supplement_table(facts).view()
    if path.suffix != ".xlsx":
        write_whole(path, text_of(view, "latex" if path.suffix == ".tex" else "csv"))
        return
    head, *rows = csv.reader(io.StringIO(text_of(view, "csv")))  # uncertainties in columns of their own
    write_table(path, {name: _column([row[place] for row in rows]) for place, name in enumerate(head)})


def _column(cells: Sequence[str]) -> Column:
    """Texts, or numbers where all are."""
    if not all(is_number(cell) for cell in cells if cell):
        return cells
    return [float(cell) if cell else None for cell in cells]


def supplement_table(facts: FolderFacts) -> Table:
    """Return the table of curves: name, columns of ``curves.csv``, values ± combined uncertainty, residual, verdict.

    The last column is "yes" for a curve that is used, else the reason why it is not.
    """
    folder = facts.folder
    # Unit and factor from SI of each value.
    unit_and_factor = {name: display_unit(folder.units.get(name, "1")) for name in facts.values}
    heads = [f"{readable(name)}\n{word}" if word != "1" else name for name, (word, _) in unit_and_factor.items()]
    columns = folder.columns
    columns_left = ["curve", *columns, "verdict", "used"]
    rows = [
        [
            row.curve, *(row.groups.get(column, "") for column in columns),
            *(_value(row, name, factor) for name, (_, factor) in unit_and_factor.items()),
            _rms(row), row.verdict, "yes" if row.usable else exclusion_of(row),
        ]
        for row in facts.rows
    ]  # fmt: skip
    return Table.of("", ["curve", *columns, *heads, "residual RMS\nmN", "verdict", "used"], rows, columns_left)


def _value(row: CurveRow, name: str, factor: float) -> str:
    value, combined = row.number(name), row.number(f"{name}_combined")
    if value is None:
        return ""
    number = value_with_uncertainty(factor * value, float("nan") if combined is None else factor * combined)
    verdict = row.verdict_of(name)
    return f"{number} {verdict}" if is_open(verdict) else number


def _rms(row: CurveRow) -> str:
    rms = row.number("rms")
    return "" if rms is None else f"{1e3 * rms:.3g}"
