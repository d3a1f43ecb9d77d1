"""``palpate material``: what rheometers, DMAs and dynamometers have written, as it is read."""

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

    Nothing is guessed: what a table does not state is asked for. `palpate material fit` fits laws to them, `palpate
    agree --reference FILE` compares runs with them.
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
    """One row for each table."""
    word, factor = display_unit("Pa")
    rows = []
    for table in tables:
        inverse = table.kind == "creep"
        scale, unit = (1.0 / factor, f"1/{word}") if inverse else (factor, word)
        values = ", ".join(f"{name} {_span(scale * table.y[:, k])} {unit}" for k, name in enumerate(letters(table)))
        axis = f"{_span(table.x)} {frequency_or_time(table.kind)}".removesuffix(" 1")
        at = [] if table.strain is None else [f"{_span(100 * table.strain)} %"]
        at += [] if table.temperature is None else [f"{_span(table.temperature)} °C"]
        name = printable(table.title or table.source)
        rows.append((name, f"{table.format}: {table.kind}", str(len(table.x)), axis, values, ", ".join(at)))
    return Table.of("", ("table", "read as", "rows", "over", "values", "at"), rows)


def _span(values: Floats) -> str:
    """From the least to the largest, or one number."""
    low, high = (f"{value:.4g}" for value in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"{low} to {high}"


def document(table: MaterialTable) -> dict[str, Any]:
    """Everything as plain data [SI]."""
    plain = {key: None if one is None else one.tolist() for key, one in _arrays(table).items()}
    return {
        "source": table.source, "title": table.title, "format": table.format, "kind": table.kind,
        "shear": table.shear, **plain, "notes": table.notes,
    }  # fmt: skip


def _arrays(table: MaterialTable) -> dict[str, Floats | None]:
    return {key: getattr(table, key) for key in ("x", "y", "std", "strain", "temperature")}
