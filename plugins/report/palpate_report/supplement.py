"""The table of a folder of fits for a supplement: a row for each curve, every column with its unit in the header."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, is_number
from palpate_engine import display_unit, whole_file, write_whole
from palpate_kit.curves.fit_folder import CurveRow
from palpate_kit.terminal.layout import text_of
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

from palpate_report.folder_facts import FolderFacts, exclusion_of

SUFFIXES = (".csv", ".tex", ".xlsx")


def write_supplement(facts: FolderFacts, path: Path) -> None:
    """Write the table, as CSV, LaTeX or a workbook by the name; raises ConfigurationError, OutputError."""
    if path.suffix not in SUFFIXES:
        raise ConfigurationError(f"--supplement {path}: a table's name ends in {', '.join(SUFFIXES)}")
    view = supplement_table(facts).view()
    if path.suffix == ".tex":
        write_whole(path, text_of(view, "latex"))
        return
    text = text_of(view, "csv")
    if path.suffix == ".csv":
        write_whole(path, text)
    else:
        _write_workbook(list(csv.reader(io.StringIO(text))), path)


def supplement_table(facts: FolderFacts) -> Table:
    """Curve, its columns of ``curves.csv``, values with combined uncertainty, residual, verdict, whether it is used."""
    folder = facts.folder
    shown = {name: display_unit(folder.units.get(name, "1")) for name in facts.values}
    heads = [f"{name.replace('_', ' ')}\n{word}" if word != "1" else name for name, (word, _) in shown.items()]
    columns = folder.columns
    left = ["curve", *columns, "verdict", "used"]
    rows = [
        [
            row.curve, *(row.groups.get(column, "") for column in columns),
            *(_value(row, name, factor) for name, (_, factor) in shown.items()),
            _rms(row), row.verdict, "yes" if row.usable else exclusion_of(row),
        ]
        for row in facts.rows
    ]  # fmt: skip
    return Table.of("", ["curve", *columns, *heads, "residual RMS\nmN", "verdict", "used"], rows, left)


def _value(row: CurveRow, name: str, factor: float) -> str:
    value, combined = row.number(name), row.number(f"{name}_combined")
    if value is None:
        return ""
    return value_with_uncertainty(factor * value, float("nan") if combined is None else factor * combined)


def _rms(row: CurveRow) -> str:
    rms = row.number("rms")
    return "" if rms is None else f"{1e3 * rms:.3g}"


def _write_workbook(rows: list[list[str]], path: Path) -> None:
    try:
        from openpyxl import Workbook
    except ImportError as error:
        raise ConfigurationError(f"{path}: a workbook needs openpyxl: pip install 'palpate[excel]'") from error
    book = Workbook()
    sheet: Any = book.active
    sheet.title = "curves"
    for number, row in enumerate(rows):
        for column, cell in enumerate(row, start=1):
            place = sheet.cell(number + 1, column)
            place.value = float(cell) if number and is_number(cell) else cell
            if not isinstance(place.value, float) and cell:
                place.data_type = "s"  # a text, whatever it begins with: never a formula
    sheet.freeze_panes = "B2"
    with whole_file(path, binary=True) as file:
        book.save(file)
