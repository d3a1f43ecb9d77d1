"""Files of tables that are not text: workbooks and arrays; also arrays of JSON."""

from __future__ import annotations

from pathlib import Path

from palpate_records.log_files import regular
from palpate_records.tables.array_files import ARRAY_FILES, array_tables, array_text
from palpate_records.tables.workbook import WORKBOOKS, sheets_with_numbers, workbook_text

BINARY_TABLES = (*WORKBOOKS, *ARRAY_FILES)


def is_binary_table(path: Path) -> bool:
    """Return True for a file with the ending of a workbook or of arrays."""
    return path.name.lower().endswith(BINARY_TABLES)


def binary_table_text(path: Path, sheet: str | None) -> str:
    """Return a table of a file with tabs between its cells, the first if none is named; raises LogError."""
    regular(path)
    return workbook_text(path, sheet) if path.name.lower().endswith(WORKBOOKS) else array_text(path, sheet)


def record_sheets(path: Path) -> list[str]:
    """Return the names of the tables of numbers in a file; raises LogError."""
    regular(path)
    if path.name.lower().endswith(WORKBOOKS):
        return sheets_with_numbers(path)
    return [table.name for table in array_tables(path)]
