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
_LOOKED = 400  # rows in which a sheet's first numbers are looked for


def workbook_text(path: Path, sheet: str | None) -> str:
    """Return a sheet with tabs between its cells, the first with rows of numbers if none is named; raises LogError."""
    about = path.stat()
    return _text(path, sheet, about.st_mtime_ns, about.st_size)


def sheets_with_numbers(path: Path) -> list[str]:
    """Names of a workbook's sheets with rows of numbers; raises LogError."""
    with _opened(path) as book:
        return [sheet.title for sheet in _numbered(book)]


@lru_cache(maxsize=1)
def _text(path: Path, sheet: str | None, changed: int, size: int) -> str:
    with _opened(path) as book:
        return _tabbed(_sheet(path, book, sheet))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        from openpyxl import load_workbook
    except ImportError as error:
        raise LogError(f"{path}: a workbook needs openpyxl: pip install 'palpate[excel]'") from error
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            with zipfile.ZipFile(file) as packed:
                if sum(part.file_size for part in packed.infolist()) > largest(path.stat().st_size):
                    raise LogError(f"{path}: it unpacks to more than a workbook of its size does")
            warnings.simplefilter("ignore")  # styles and the like, which are not numbers
            book = load_workbook(file, read_only=True, data_only=True)
            try:
                yield book
            finally:
                book.close()
    except LogError:
        raise
    except Exception as error:  # whatever unpacking, XML and cells raise on a damaged file
        raise LogError(f"{path}: is not a workbook that can be read: {type(error).__name__}: {error}") from error


def _sheet(path: Path, book: Any, name: str | None) -> Any:
    sheets = {sheet.title: sheet for sheet in book.worksheets}
    if name is not None:
        if name not in sheets:
            raise LogError(f"{path}: no sheet {name!r}{suggest(name, list(sheets))} (there are: {', '.join(sheets)})")
        return sheets[name]
    if not (numbered := _numbered(book)):
        raise LogError(f"{path}: the file contains no rows of numbers")
    return numbered[0]


def _numbered(book: Any) -> list[Any]:
    return [s for s in book.worksheets if _has_numbers(islice(s.iter_rows(values_only=True), _LOOKED))]


def _has_numbers(rows: Iterable[tuple[Any, ...]]) -> bool:
    return sum(sum(isinstance(cell, int | float) for cell in row) >= 2 for row in rows) >= 3


def _tabbed(sheet: Any) -> str:
    out = io.StringIO()
    writer = csv.writer(out, delimiter="\t", lineterminator="\n")
    for row in sheet.iter_rows(values_only=True):
        writer.writerow([_cell(cell) for cell in row])
    return out.getvalue()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime | time):
        return value.isoformat()
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    return (
        " ".join(value.split()) if isinstance(value, str) else repr(value) if isinstance(value, float) else str(value)
    )
