"""Workbooks of Excel as tables of text."""

from __future__ import annotations

import csv
import io
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime, time, timedelta
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from palpate import LogError, suggest

from palpate_records.decompression import largest

WORKBOOKS = (".xlsx", ".xlsm")
# Choices.
_PROBE_ROWS = 400  # of a sheet, in which its first numbers are looked for
_MIN_NUMBER_ROWS = 3  # with two numbers, by which a sheet is a table of numbers
_MIN_ROW_NUMBERS = 2


def workbook_text(path: Path, sheet: str | None) -> str:
    """Return a sheet with tabs between its cells, the first with rows of numbers if none is named; raises LogError."""
    status = path.stat()
    return _read_text(path, sheet, status.st_mtime_ns, status.st_size)


def sheets_with_numbers(path: Path) -> list[str]:
    """Return the names of a workbook's sheets with rows of numbers; raises LogError."""
    with _open_workbook(path) as book:
        return [sheet.title for sheet in _number_sheets(book)]


@lru_cache(maxsize=1)
def _read_text(path: Path, sheet: str | None, changed: int, size: int) -> str:
    """Return a sheet as text; the file's time of change [ns] and size [bytes] are only keys of the cache."""
    with _open_workbook(path) as book:
        return _tabbed_text(_named_sheet(path, book, sheet))


@contextmanager
def _open_workbook(path: Path) -> Iterator[Any]:
    """Open a workbook; whatever is wrong with it raises LogError, also while its sheets are read."""
    try:
        from openpyxl import load_workbook
    except ImportError as error:
        raise LogError(f"{path}: a workbook needs openpyxl: pip install 'palpate[excel]'") from error
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            with zipfile.ZipFile(file) as packed:
                if sum(part.file_size for part in packed.infolist()) > largest(path.stat().st_size):
                    raise LogError(f"{path}: it unpacks to more than a workbook of its size does")
            warnings.simplefilter("ignore")  # on styles and other features, which are not numbers
            book = load_workbook(file, read_only=True, data_only=True)
            try:
                yield book
            finally:
                book.close()
    except LogError:
        raise
    except Exception as error:  # unpacking, XML and cells of a damaged file may raise anything
        raise LogError(f"{path}: is not a workbook that can be read: {type(error).__name__}: {error}") from error


def _named_sheet(path: Path, book: Any, name: str | None) -> Any:
    """Return the sheet of a name, the first with rows of numbers if none is named; raises LogError without one."""
    sheets = {sheet.title: sheet for sheet in book.worksheets}
    if name is not None:
        if name not in sheets:
            raise LogError(f"{path}: no sheet {name!r}{suggest(name, list(sheets))} (there are: {', '.join(sheets)})")
        return sheets[name]
    if not (number_sheets := _number_sheets(book)):
        raise LogError(f"{path}: the file contains no rows of numbers")
    return number_sheets[0]


def _number_sheets(book: Any) -> list[Any]:
    """Return the sheets with rows of numbers."""
    return [sheet for sheet in book.worksheets if _has_numbers(islice(sheet.iter_rows(values_only=True), _PROBE_ROWS))]


def _has_numbers(rows: Iterable[tuple[Any, ...]]) -> bool:
    """Return True if some rows have several numbers each."""
    counts = (sum(isinstance(cell, int | float) for cell in row) for row in rows)
    return sum(count >= _MIN_ROW_NUMBERS for count in counts) >= _MIN_NUMBER_ROWS


def _tabbed_text(sheet: Any) -> str:
    """Return a sheet with tabs between its cells."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    for row in sheet.iter_rows(values_only=True):
        writer.writerow([_cell_text(cell) for cell in row])
    return text.getvalue()


def _cell_text(value: Any) -> str:
    """Return a cell as text: numbers in full, dates in the form of ISO 8601, durations in seconds."""
    if value is None:
        return ""
    if isinstance(value, datetime | time):
        return value.isoformat()
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    if isinstance(value, str):
        return " ".join(value.split())
    return repr(value) if isinstance(value, float) else str(value)
