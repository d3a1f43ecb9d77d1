"""The suggestion of ``palpate info FILE --suggest`` for the table of an instrument: commands, and their gaps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from palpate import LogError

from palpate_reference.instrument_text import read_text
from palpate_reference.material_table import MaterialTable, TableSettings, frequency_or_time, letters
from palpate_reference.table_blocks import GENERIC, TableBlock, table_blocks
from palpate_reference.table_columns import TableColumn, columns_of, example_unit, name_and_unit
from palpate_reference.table_reader import read_tables
from palpate_reference.table_values import moduli_among

_MIN_TEMPERATURE_RANGE = 5.0  # [K], a choice: over less nothing is shifted
_MAX_BYTES = 5_000_000  # of a table of an instrument, a choice: larger files are logs
_CERTAIN_ROLES = ({"modulus"}, {"compliance"}, {"strain", "stress"})  # roles that no log of a press has, as moduli are
_LOG_NAMES = re.compile("force|load|kraft|displacement|extension|position|weg", re.IGNORECASE)


def suggested_commands(path: Path) -> Sequence[str] | None:
    """Return commands for a table of an instrument, with ``...`` for their gaps; None for any other file."""
    if path.stat().st_size > _MAX_BYTES:
        return None
    try:
        text = read_text(path)
        blocks = table_blocks(text)
        columns = [columns_of(text, block, {}) for block in blocks]
    except LogError:
        return None
    if not any(_is_of_material(block, block_columns) for block, block_columns in zip(blocks, columns, strict=True)):
        return None
    units = _units_to_state(columns)
    options = "".join(f" --unit {quote(f'{name}=...')}" for name in units)
    lines = [f"# {path.name}: a table of an instrument, not a log"]
    lines += [f"# fill in the unit of {name!r}: {', '.join(examples)}" for name, examples in units.items()]
    tables: list[MaterialTable] = []
    if not units:
        try:
            tables = read_tables(path, TableSettings({}))
        except LogError as error:
            lines.append(f"# to be settled: {error}")
            options += " --modulus ..." if "--modulus" in str(error) else ""
    lines += [f"# {_summary(table)}" for table in tables]
    return [*lines, *_commands(quote(str(path)) + options, tables)]


def _commands(source: str, tables: Sequence[MaterialTable]) -> list[str]:
    """Return the commands for tables; for any kind of table where they are not known yet."""
    kinds = {table.kind for table in tables}
    temperature_columns = [table.temperature for table in tables if table.temperature is not None]
    temperatures = [temperature for column in temperature_columns for temperature in column]
    commands = [f"palpate material {source}"]
    if temperatures and max(temperatures) - min(temperatures) > _MIN_TEMPERATURE_RANGE:
        commands.append(f"palpate material master {source}")
    loading = " --loading ..." if kinds == {"stress-strain"} else ""
    commands.append(f"palpate material fit {source} --scale '2 %'{loading}")
    if not kinds or kinds & {"oscillation", "stress-strain"}:
        commands.append(f"palpate material agree RUN --reference {source} --uncertainty '2 %'")
    return commands


def _is_of_material(block: TableBlock, columns: dict[str, TableColumn]) -> bool:
    """Return True if a table holds moduli, or stress over strain without the force and travel of a log."""
    if block.format != GENERIC and columns:
        return True
    # A name of one letter, such as E or z, may be anything.
    named = {role for role, column in columns.items() if len(name_and_unit(column.name)[0]) > 1}
    if not moduli_among(named) and not any(roles <= named for roles in _CERTAIN_ROLES):
        return False
    return not any(_LOG_NAMES.search(name) for name in block.names)


def _units_to_state(columns: Sequence[dict[str, TableColumn]]) -> dict[str, tuple[str, ...]]:
    """Return the columns without a unit that the tables need, and examples of units for each."""
    units: dict[str, tuple[str, ...]] = {}
    for block_columns in columns:
        for column in block_columns.values():
            examples = example_unit(column.role)
            if not column.unit and examples:
                units.setdefault(column.name, examples)
    return units


def _summary(table: MaterialTable) -> str:
    """Return one line on the content of a table."""
    unit = frequency_or_time(table.kind)
    span = f"{table.x.min():.4g} to {table.x.max():.4g} {unit}".removesuffix(" 1")
    return (
        f"{table.title or table.source}: {table.kind}, {len(table.x)} rows of {', '.join(letters(table))} over {span}"
    )
