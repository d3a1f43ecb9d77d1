"""A table of numbers as it is read: at once where lines hold nothing but numbers, else line by line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Floats, LogError
from palpate_records.messages.readings import LATEST, SECOND, nanoseconds, sensible
from palpate_records.tables.cells import is_cut_at_commas
from palpate_records.tables.clock_times import Days
from palpate_records.tables.csv_layout import TableLayout, first_lines, layout_of
from palpate_records.tables.csv_truncation import cut_number
from palpate_records.tables.dialect import TableRow
from palpate_records.tables.footer import is_event
from palpate_records.tables.plain_numbers import lines_from, plain_numbers, whole_lines
from palpate_records.tables.table_forms import table_form
from palpate_records.tables.table_records import pages_of, record_named
from palpate_records.tables.table_rows import rows_below
from palpate_records.tables.table_text import bounded_lines, open_text

from palpate_logs.csv_columns import CellReader, column_indices, demand_units, requested_columns
from palpate_logs.csv_settings import CsvSettings
from palpate_logs.sample_hold import SampleHold

_BATCH_ROWS = 4096  # in one batch, a choice: memory against calls


class CsvLink:
    """A table that is read."""

    def __init__(self, log: CsvSettings) -> None:
        self._log = log
        self._dialect = log.dialect
        self._record = None if log.record is None else record_named(log.file, log.record, log.written)
        # A record states its own line of names and its sheet.
        self._header = log.header if self._record is None else self._record.header or log.header
        self._sheet = log.sheet if self._record is None else self._record.sheet or log.sheet
        self._columns = requested_columns(log)
        self._factors = np.array([column.factor for column in self._columns])
        self._has_clock = log.time is not None and self._columns[-1].is_clock
        # These are known once the first lines are read.
        self._layout = TableLayout(0, 0)
        self._indices: list[int] = []  # of the requested columns in the file
        self._max_width = 0  # cells of the longest line
        self._last_width = 0  # cells of the latest line
        self._last_line = 0  # number of the latest line, from 1

    def batches(self) -> Iterator[Batch]:
        """Yield the rows of the file in order, some thousand at a time, without repeats of held readings."""
        tally = self._log.tally
        tally.timeless = 0
        tally.overload = 0
        tally.cut = None
        row_count = 0
        first_stamp: int | None = None
        days, hold = Days(), SampleHold()
        for numbers in self._undamaged_blocks():
            with np.errstate(over="ignore"):  # a number that is not finite counts as invalid
                numbers_si = numbers * self._factors
            stamps, readings = self._timed_readings(numbers_si, row_count, days)
            row_count += len(numbers)
            if first_stamp is None and len(stamps):
                first_stamp = int(stamps[0])
            rows = self._rows_within(stamps - (first_stamp or 0))
            stamps = stamps[rows]
            readings = hold.without_repeats(readings[rows])
            yield Batch("", stamps, stamps, sensible(readings))
        if row_count == 0:
            raise LogError(f"{self._log.file}: the file contains no rows of numbers")
        rows_per_reading = zip(self._log.columns, hold.rows, strict=False)
        tally.held = {channel: rows for channel, rows in rows_per_reading if rows > 1}

    def _timed_readings(self, numbers: Floats, first_row: int, days: Days) -> tuple[NDArray[np.int64], Floats]:
        """Return the time-stamps (n,) [ns] and the channels (n, channels) of numbers (rows, columns) [SI].

        The time is that of the rate from the number of the first row on, or the last column plus the nanoseconds in the
        column before. A row without a finite time is left out, and counted. `days` has the day of the latest time.
        """
        time = self._log.time
        if time is None:
            assert self._log.rate is not None  # the settings have one of both
            rows = first_row + np.arange(len(numbers))
            return np.rint(rows * (SECOND / self._log.rate)).astype(np.int64), numbers
        seconds, readings = numbers[:, -1], numbers[:, :-1]
        if time.nanoseconds is not None:
            seconds, readings = seconds + readings[:, -1], readings[:, :-1]
        if self._has_clock:
            seconds = days.unwrapped(seconds)
        is_timed = np.isfinite(seconds) & (np.abs(seconds) < LATEST)
        self._log.tally.timeless += int(np.count_nonzero(~is_timed))
        return nanoseconds(seconds[is_timed]), readings[is_timed]

    def _rows_within(self, elapsed: NDArray[np.int64]) -> NDArray[np.bool_] | slice:
        """Return the rows of the requested part of the file, by their times (n,) [ns] since the first row."""
        begin, end = self._log.begin, self._log.end
        if begin is None and end is None:
            return slice(None)
        is_within = elapsed >= (0 if begin is None else round(begin * SECOND))
        if end is not None:
            is_within &= elapsed <= round(end * SECOND)
        return is_within

    def _undamaged_blocks(self) -> Iterator[Floats]:
        """Yield the numbers (n, columns) of all rows except a last one that was cut within its last number."""
        block = None
        for next_block in self._blocks():
            if block is not None:
                yield block
            block = next_block
        if block is None:
            return
        # A time of day that was cut is not a time, and refused as such.
        reads_last_column = self._layout.width - 1 in self._indices
        cut = None
        if reads_last_column and not self._has_clock:
            cut = cut_number(self._log.file, self._dialect.delimiter, self._dialect.decimal)
        self._log.tally.cut = cut
        yield block if cut is None else block[:-1]

    def _blocks(self) -> Iterator[Floats]:
        """Yield the numbers (n, columns) of all rows, in the units of the file: some thousand rows at a time."""
        path = self._log.file
        with open_text(path, self._log.encoding, self._sheet) as file:
            self._find_columns(first_lines(file, path, self._header or 0))
            file.seek(0)
            line = sum(1 for _ in islice(bounded_lines(file, path), self._layout.begin))  # number of the latest line
            for text in whole_lines(file):
                numbers = self._plain_numbers(text)
                if numbers is None:  # from the first cell that is not a plain number on, line by line
                    yield from self._blocks_by_line(lines_from(text, file, path), line - self._layout.begin)
                    break
                line += len(numbers)
                self._max_width = self._layout.width
                self._last_width = self._layout.width
                self._last_line = line
                yield numbers
            self._refuse_cut_line()

    def _find_columns(self, lines: Sequence[str]) -> None:
        """Find the layout of the file by its first lines, and the requested columns in it; raises LogError."""
        path, units = self._log.file, self._log.units
        stated = self._dialect, self._header, units
        _, layout = table_form(lines, stated, lambda: (self._dialect, layout_of(path, lines, *stated)))
        self._layout = layout if self._record is None else self._record.layout(layout)
        self._indices = column_indices(self._columns, self._layout, path)
        if units != 0:
            demand_units(self._columns, self._indices, self._layout, path)

    def _plain_numbers(self, text: str) -> Floats | None:
        """Return the numbers (n, columns) of whole lines of nothing but numbers; None for other lines."""
        if self._record is not None or self._has_clock or max(self._indices, default=0) >= self._layout.width:
            return None
        numbers = plain_numbers(text, self._dialect, self._layout.width)
        return None if numbers is None else numbers[:, self._indices]

    def _blocks_by_line(self, lines: Iterator[str], rows_above: int) -> Iterator[Floats]:
        """Yield the numbers (n, columns) of lines that may hold anything, below a number of rows that were read."""
        tally = self._log.tally
        tally.footer.clear()  # of an earlier reading of the file
        tally.events.clear()
        reader = CellReader(self._log.file, self._dialect, self._columns, self._indices, tally)
        rows = rows_below(
            above=rows_above,
            lines=lines,
            layout=self._layout,
            dialect=self._dialect,
            record=self._record,
            pages=self._page_count,
            footer=tally.footer,
        )
        while block := list(islice(rows, _BATCH_ROWS)):
            number_rows: list[TableRow] = []
            for line, cells in block:
                # If rows have a time, a line of words may stand between them: rows that it replaced are a gap.
                if self._log.time is not None and is_event(cells, self._layout.width, self._dialect):
                    tally.events.append(cells[0])
                elif cells:
                    self._demand_width(cells, line)
                    number_rows.append((line, cells))
            if number_rows:
                yield reader.numbers(number_rows)

    def _page_count(self) -> int:
        """Return the number of tables under each other that are one record; 0 if nothing is known of those below."""
        if self._record is not None and self._record.header is not None:
            return self._record.pages
        page_count = pages_of(self._log.file, self._log.written)
        return page_count if page_count > 1 or self._header else 0

    def _demand_width(self, cells: list[str], line: int) -> None:
        """Raise LogError for a line with more cells than the first: all behind an added cell are in wrong columns."""
        width = self._layout.width
        self._max_width = max(self._max_width, len(cells))
        self._last_width = len(cells)
        self._last_line = line
        if not any(cell.strip() for cell in cells[width:]):
            return
        where = f"{self._log.file}:{line}"
        if is_cut_at_commas(cells, self._layout.names, self._dialect.delimiter):
            advice = "these look like decimal commas; write the numbers with points, or another separator"
            raise LogError(f"{where}: {len(cells)} cells under a header of {len(self._layout.names or ())}: {advice}")
        widths = f"the line has {len(cells)} cells, the first one {width}"
        raise LogError(f"{where}: {widths}: its numbers would be in the wrong columns")

    def _refuse_cut_line(self) -> None:
        """Raise LogError if the last line has fewer cells than others: its last number may be cut as well."""
        if self._last_width < self._max_width:
            raise LogError(
                f"{self._log.file}:{self._last_line}: the last line has {self._last_width} of {self._max_width} cells, "
                "so the file was cut there; remove that line to read the others"
            )
