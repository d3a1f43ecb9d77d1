"""Pages of one record: tables under each other with the same names, whose time, force and height continue."""

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

# Choices.
_EDGE_ROWS = 20  # at either end of a page, by which it is compared with the next
_MIN_INTERVAL, _MAX_INTERVAL = 0.5, 1.5  # usual intervals between two pages of one record: one, with jitter
_MAX_STEP_RATIO = 5.0  # of the step between two pages of one record to the largest one within their edges
_MIN_JUMP = 0.01  # of the range of a column; a smaller step is a digit of a column that stands still


@dataclass
class _PageEdges:
    """The rows of numbers at both ends of a page, and the lines between its names and its first row."""

    first: list[list[float]] = field(default_factory=list)
    last: deque[list[float]] = field(default_factory=lambda: deque(maxlen=_EDGE_ROWS))
    head: list[str] = field(default_factory=list)


def continued_pages(sheet: Sheet, heads: Sequence[int], time: int, signals: Sequence[int], file: IO[str]) -> list[bool]:
    """Return for each page True if it continues the page above it; False for the first.

    A page begins with the names of the columns again; `sheet` is the text with its columns. `heads` are the lines of
    the names, counted from 1, `time` and `signals` columns. The units must be equal, the time one interval later, and
    no signal may jump.
    """
    pages = list(_page_edges(sheet, heads, (time, *signals), file))
    rows = [row for page in pages for row in (*page.first, *page.last)]
    if not rows or not all(page.first for page in pages):
        return [False] * len(heads)
    spans = np.nanmax(rows, axis=0) - np.nanmin(rows, axis=0)
    continues = (
        page.head == next_page.head and _continues(page, next_page, spans) for page, next_page in pairwise(pages)
    )
    return [False, *continues]


def _continues(page: _PageEdges, next_page: _PageEdges, spans: Floats) -> bool:
    """Return True if the first row of a page follows the last of the page above it; `spans` are ranges of columns."""
    last_rows = np.array(page.last)
    first_rows = np.array(next_page.first)
    steps = np.concatenate([np.diff(last_rows, axis=0), np.diff(first_rows, axis=0)])
    step_between = first_rows[0] - last_rows[-1]
    interval = float(np.median(steps[:, 0])) if len(steps) else 0.0
    if not (interval > 0.0 and _MIN_INTERVAL * interval <= step_between[0] <= _MAX_INTERVAL * interval):
        return False
    max_steps = np.maximum(_MAX_STEP_RATIO * np.abs(steps[:, 1:]).max(axis=0), _MIN_JUMP * spans[1:])
    return bool((np.abs(step_between[1:]) <= max_steps).all())


def _page_edges(sheet: Sheet, heads: Sequence[int], columns: Sequence[int], file: IO[str]) -> Iterator[_PageEdges]:
    """Yield the edges of every page of a table: lines of units, and numbers of some columns in its first and last rows.

    `heads` are the lines of the names, counted from 1.
    """
    page: _PageEdges | None = None
    begins = {*heads}
    for line, text in enumerate(bounded_lines(file, sheet.path), 1):
        if line in begins:
            if page is not None:
                yield page
            page = _PageEdges()
        # Lines between the names and the first numbers are units, equal on pages of one record.
        elif page is not None and text.strip() and not sheet.dialect.is_comment(text):
            cells = next(iter(sheet.dialect.rows([text])), [])
            row = [_number_in_row(sheet, cells, k) for k in columns]
            if np.isfinite(row).all():
                page.last.append(row)
                if len(page.first) < _EDGE_ROWS:
                    page.first.append(row)
            elif not page.first:
                page.head.append(text.strip())
    if page is not None:
        yield page


def _number_in_row(sheet: Sheet, cells: Sequence[str], column: int) -> float:
    """Return the number of a column in a row, a time of day in seconds; NaN for any other cell."""
    cell = cells[column].strip() if column < len(cells) else ""
    if column in sheet.layout.clocks:
        return seconds_or_nan(cell)
    return number_or_nan(number_and_unit(cell)[0], sheet.dialect.decimal, sheet.dialect.thousands)
