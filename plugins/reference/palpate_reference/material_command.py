"""``palpate material``: the tables of rheometers, DMAs and dynamometers, as they are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import Floats, printable
from palpate_engine import display_unit
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FormatOption, JsonOption
from palpate_kit.terminal.table import Table, console

from palpate_reference.material_table import MaterialTable, frequency_or_time, letters
from palpate_reference.table_options import ColumnOption, ModulusOption, UnitOption, table_settings
from palpate_reference.table_reader import read_tables


def material(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Tables of a rheometer, DMA or dynamometer.")],
    units: UnitOption = None,
    modulus: ModulusOption = None,
    columns: ColumnOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Print what tables of a material hold, and how they are read: TRIOS, RheoCompass, any CSV with a header.

    Nothing is guessed: what a table does not state is asked for. `palpate material fit` fits laws to them,
    `palpate material agree --reference FILE` compares runs with them.
    """
    settings = table_settings(units, modulus, columns)
    tables = [table for path in files for table in read_tables(path, settings)]
    if as_json:
        print_json({"tables": [document(table) for table in tables]})
        return
    screen = console()
    screen.print(overview(tables).view(), highlight=False)
    for table in tables:
        for note in table.notes:
            screen.print(printable(f"{table.name}: {note}"), highlight=False)


def overview(tables: Sequence[MaterialTable]) -> Table:
    """Return one row for each table."""
    unit, factor = display_unit("Pa")
    rows = []
    for table in tables:
        # A compliance is shown in the inverse unit.
        value_scale, value_unit = (1.0 / factor, f"1/{unit}") if table.kind == "creep" else (factor, unit)
        columns = enumerate(letters(table))
        values = ", ".join(f"{name} {_span(value_scale * table.y[:, k])} {value_unit}" for k, name in columns)
        axis = f"{_span(table.x)} {frequency_or_time(table.kind)}".removesuffix(" 1")
        conditions = []
        if table.strain is not None:
            conditions.append(f"{_span(100 * table.strain)} %")
        if table.temperature is not None:
            conditions.append(f"{_span(table.temperature)} °C")
        name = printable(table.title or table.source)
        rows.append((name, f"{table.format}: {table.kind}", str(len(table.x)), axis, values, ", ".join(conditions)))
    return Table.of("", ("table", "read as", "rows", "over", "values", "at"), rows)


def _span(values: Floats) -> str:
    """Return the range of values (n,), or one number if all are the same to four digits."""
    low, high = (f"{value:.4g}" for value in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"{low} to {high}"


def document(table: MaterialTable) -> dict[str, Any]:
    """Return a table as plain data [SI]."""
    columns = {key: getattr(table, key) for key in ("x", "y", "std", "strain", "temperature")}
    return {
        "source": table.source,
        "title": table.title,
        "format": table.format,
        "kind": table.kind,
        "shear": table.shear,
        **{key: None if column is None else column.tolist() for key, column in columns.items()},
        "notes": table.notes,
    }
