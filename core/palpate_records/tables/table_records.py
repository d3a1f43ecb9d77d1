"""Several records in one table file: sheets, tables under each other or side by side, a column that names them."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import chain, islice
from pathlib import Path
from typing import IO

from palpate import LogError, printable, suggest

from palpate_records.tables.binary_tables import is_binary_table, record_sheets
from palpate_records.tables.csv_names import words_of
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.plain_numbers import whole_lines, without_digits
from palpate_records.tables.record_columns import (
    MAX_RECORD_NAME,
    NAMING,
    PRESS_ROLES,
    column_role,
    records_by_column,
    records_side_by_side,
)
from palpate_records.tables.table_pages import continued_pages
from palpate_records.tables.table_record import TableRecord
from palpate_records.tables.table_text import bounded_lines, open_text

RECORD = "record"  # key among those that can be stated, which names one of the records
# Choices.
_MAX_RECORDS = 2000  # of a file
_MAX_SHOWN = 6  # records that are named in a message
_CACHED_FILES = 8  # whose records are kept
_CACHED_SHEETS = 1 << 14  # that are kept, 2 kB each: a folder is read twice


def records_in(path: Path, stated: Mapping[str, str] | None = None) -> tuple[TableRecord, ...]:
    """Return the records of a file that holds several, by its `stated` keys; empty for a file that is one record."""
    records = _parts_of_file(path, stated or {})
    return records if len(records) > 1 else ()


def pages_of(path: Path, stated: Mapping[str, str | int]) -> int:
    """Return the number of pages of the only record of a file, or of the record with a stated header."""
    texts = {key: str(value) for key, value in stated.items()}
    header = texts.pop("header", None)
    records = [record for record in _parts_of_file(path, texts) if header is None or str(record.header) == header]
    return records[0].pages if len(records) == 1 else 1


def _parts_of_file(path: Path, stated: Mapping[str, str]) -> tuple[TableRecord, ...]:
    """Return the records of a file; of a file that is one record this one if it is in pages."""
    status = path.stat()
    return _read_records(path, tuple(sorted(stated.items())), status.st_mtime_ns, status.st_size)


def record_named(path: Path, name: str, stated: Mapping[str, str] | None = None) -> TableRecord:
    """Return the record of a name; raises LogError if it is missing."""
    records = records_in(path, stated)
    for record in records:
        if record.name == name:
            return record
    names = [record.name for record in records]
    raise LogError(f"{path}: no record {name!r}{suggest(name, names) if names else ': it is one'}")


def records_note(path: Path, stated: Mapping[str, str]) -> str | None:
    """Return a sentence on a file that holds several records, none of which is stated; None for any other file."""
    names = [] if RECORD in stated else [record.name for record in records_in(path, stated)]
    if not names:
        return None
    more = ", ..." if len(names) > _MAX_SHOWN else ""
    return (
        f"the file holds {len(names)} records ({', '.join(names[:_MAX_SHOWN])}{more}): record = NAME reads one of them"
    )


def sheet_of(path: Path, stated: Mapping[str, str] | None = None) -> Sheet:
    """Return the table of a file, or the record of it that is stated; raises LogError."""
    keys = dict(stated or {})
    name = keys.pop(RECORD, None)
    if name is not None:
        return Sheet.of(path, keys, record_named(path, name, keys))
    return replace(_whole_sheet(path, keys), pages=pages_of(path, keys))


def _whole_sheet(path: Path, stated: Mapping[str, str]) -> Sheet:
    """Return the table of a file as if it were one record; raises LogError."""
    status = path.stat()
    return _read_sheet(path, tuple(sorted(stated.items())), status.st_mtime_ns, status.st_size)


@lru_cache(_CACHED_SHEETS)
def _read_sheet(path: Path, stated: tuple[tuple[str, str], ...], changed: int, size: int) -> Sheet:
    """Return the table of a file; its time of change [ns] and size [bytes] are only keys of the cache."""
    return Sheet.of(path, dict(stated))


@lru_cache(_CACHED_FILES)
def _read_records(path: Path, stated: tuple[tuple[str, str], ...], changed: int, size: int) -> tuple[TableRecord, ...]:
    """Return the records of a file; its time of change [ns] and size [bytes] are only keys of the cache.

    Each sheet of a workbook is a record, or holds several. Raises LogError for too many.
    """
    keys = dict(stated)
    records: list[TableRecord] = []
    if is_binary_table(path) and "sheet" not in keys:
        sheets = record_sheets(path)
        for sheet in sheets if len(sheets) > 1 else ():
            parts = _records_of_table(path, {**keys, "sheet": sheet})
            if len(parts) > 1:
                records += [replace(part, name=f"{sheet}:{part.name}", sheet=sheet) for part in parts]
            else:
                records += [replace(part, name=sheet, sheet=sheet) for part in parts or [TableRecord(sheet)]]
    records = records or _records_of_table(path, keys)
    if len(records) > _MAX_RECORDS:
        raise LogError(f"{path}: holds {len(records)} records; {_MAX_RECORDS} are read at most: split the file")
    return tuple(records)


def _records_of_table(path: Path, stated: Mapping[str, str]) -> list[TableRecord]:
    """Return the records in a text or in a sheet; of a single record this one if it is in pages.

    A table that cannot be read has none: its reader reports the error.
    """
    with suppress(LogError):
        sheet = _whole_sheet(path, stated)
        if sheet.header and len(sheet.names) > 1:
            stacked = [] if "header" in stated else _stacked_records(sheet)
            return stacked or records_side_by_side(sheet) or records_by_column(sheet)
    return []


def _stacked_records(sheet: Sheet) -> list[TableRecord]:
    """Return the records of tables under each other that have the same names; each is called by the title above it."""
    names = [name.strip() for name in sheet.names]
    tables = list[tuple[int, str]]()  # line and title
    title = ""
    with open_text(sheet.path, *sheet.text_keys) as file:
        for line, text in _lines_with_letters(file, sheet):
            cells = [cell.strip() for cell in next(iter(sheet.dialect.rows([text])), [])]
            if cells == names:
                tables.append((line, title))
                title = ""
            elif sum(map(bool, cells)) == 1:
                title = printable("".join(cells))[:MAX_RECORD_NAME]
    return _records_of_tables(sheet, tables) if len(tables) > 1 else []


def _records_of_tables(sheet: Sheet, tables: Sequence[tuple[int, str]]) -> list[TableRecord]:
    """Return the records of tables by line and title; a table that continues the one above is a page of its record."""
    records = list[TableRecord]()
    for (line, title), continues in zip(tables, _continuations(sheet, tables), strict=True):
        # A title such as "Specimen 2" begins a record, whatever its time.
        if continues and not NAMING & {*words_of(title)}:
            records[-1] = replace(records[-1], pages=records[-1].pages + 1)
        else:
            records.append(TableRecord(title or str(len(records) + 1), header=line))
    if len({record.name for record in records}) < len(records):
        records = [replace(record, name=str(number)) for number, record in enumerate(records, 1)]
    return records


def _continuations(sheet: Sheet, tables: Sequence[tuple[int, str]]) -> list[bool]:
    """Return for each table, by line and title, True if it continues the one above; never so without a time."""
    roles = [column_role(sheet, column) for column in range(len(sheet.names))]
    if "time" not in roles:
        return [False] * len(tables)
    time = roles.index("time")
    signals = [column for column, role in enumerate(roles) if role in PRESS_ROLES]
    number_columns = [column for column in sorted(sheet.layout.numbers) if column != time]
    with open_text(sheet.path, *sheet.text_keys) as file:
        return continued_pages(sheet, [line for line, _ in tables], time, signals or number_columns, file)


def _lines_with_letters(file: IO[str], sheet: Sheet) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold a letter, with their numbers from 1 on."""
    lines_above = [*islice(bounded_lines(file, sheet.path), sheet.layout.begin)]
    count = 0
    for text in chain(lines_above, whole_lines(file)):
        lines = [*io.StringIO(text, newline="")]
        # Whole blocks of numbers have no letter but the e of an exponent.
        are_exponents = all(text.count(mark) == text.count(f"{mark}-") + text.count(f"{mark}+") for mark in "eE")
        if not are_exponents or any(map(str.isalpha, {*without_digits(text)})):
            yield from ((count + k, line) for k, line in enumerate(lines, 1) if any(map(str.isalpha, line)))
        count += len(lines)
