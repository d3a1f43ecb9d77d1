"""Pages of one record: tables under each other with the same names, through which time, force and height go on."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import IO

import numpy as np
from palpate import Floats

from palpate_records.tables.cell_units import number_and_unit
from palpate_records.tables.cells import number_or_nan
from palpate_records.tables.clock_times import seconds_or_nan
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.table_text import bounded_lines

_EDGE = 20  # rows at either end of a page by which it is compared with the next
_INTERVALS = (0.5, 1.5)  # usual intervals between two pages of one record: one, with the jitter of a logger
_STEPS = 5.0  # largest steps within the edges that a step between two pages of one record has, at most
_FLAT = 0.01  # of the range of a column, below which a step is not a jump: a digit of a column that stands still


@dataclass
class _PageEdges:
    """The rows of numbers at both ends of a page, and the lines between its names and its first row."""

    first: list[list[float]] = field(default_factory=list)
    last: deque[list[float]] = field(default_factory=lambda: deque(maxlen=_EDGE))
    head: list[str] = field(default_factory=list)


def continued_pages(sheet: Sheet, heads: Sequence[int], time: int, signals: Sequence[int], file: IO[str]) -> list[bool]:
    """Return for each page whether it goes on where the page above it ends; False for the first.

    `heads` are the lines of the names, counted from 1, `time` and `signals` columns. The units must be equal, the time
    one interval later, and no signal may jump.
    """
    pages = list(_page_edges(sheet, heads, (time, *signals), file))
    rows = [row for page in pages for row in (*page.first, *page.last)]
    if not rows or not all(page.first for page in pages):
        return [False] * len(heads)
    spans = np.nanmax(rows, axis=0) - np.nanmin(rows, axis=0)
    return [False, *(one.head == other.head and _goes_on(one, other, spans) for one, other in pairwise(pages))]


def _goes_on(one: _PageEdges, other: _PageEdges, spans: Floats) -> bool:
    """Return True if the first row of a page follows the last of the page above it."""
    above, below = np.array(one.last), np.array(other.first)
    steps = np.concatenate([np.diff(above, axis=0), np.diff(below, axis=0)])
    across = below[0] - above[-1]
    interval = float(np.median(steps[:, 0])) if len(steps) else 0.0
    low, high = _INTERVALS
    if not (interval > 0.0 and low * interval <= across[0] <= high * interval):
        return False
    allowed = np.maximum(_STEPS * np.abs(steps[:, 1:]).max(axis=0), _FLAT * spans[1:])
    return bool((np.abs(across[1:]) <= allowed).all())


def _page_edges(sheet: Sheet, heads: Sequence[int], columns: Sequence[int], file: IO[str]) -> Iterator[_PageEdges]:
    """Yield the edges of every page, of these columns."""
    page: _PageEdges | None = None
    begins = {*heads}
    for line, text in enumerate(bounded_lines(file, sheet.path), 1):
        if line in begins:
            if page is not None:
                yield page
            page = _PageEdges()
        elif page is not None and text.strip() and not sheet.dialect.is_comment(text):
            cells = next(iter(sheet.dialect.rows([text])), [])
            row = [_number(sheet, cells, k) for k in columns]
            if np.isfinite(row).all():
                page.last.append(row)
                if len(page.first) < _EDGE:
                    page.first.append(row)
            elif not page.first:
                page.head.append(text.strip())
    if page is not None:
        yield page


def _number(sheet: Sheet, cells: Sequence[str], column: int) -> float:
    cell = cells[column].strip() if column < len(cells) else ""
    if column in sheet.layout.clocks:
        return seconds_or_nan(cell)
    return number_or_nan(number_and_unit(cell)[0], sheet.dialect.decimal, sheet.dialect.thousands)
