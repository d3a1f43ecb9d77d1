"""A table of numbers as it is read: at once where lines hold nothing but numbers, else line by line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Floats, LogError, to_si
from palpate_records.messages.readings import LATEST, nanoseconds, sensible, si_unit
from palpate_records.tables.cell_units import cell_factor, number_and_unit
from palpate_records.tables.cells import POINTS, has_decimal_comma, is_cut_at_commas, is_overload, number
from palpate_records.tables.clock_times import CLOCK, Days, seconds_of_day
from palpate_records.tables.csv_layout import TableLayout, first_lines, layout_of
from palpate_records.tables.csv_names import weight_of
from palpate_records.tables.csv_truncation import cut_number
from palpate_records.tables.dialect import MARKS, TableRow
from palpate_records.tables.footer import is_event
from palpate_records.tables.plain_numbers import lines_from, plain_numbers, whole_lines, without_digits
from palpate_records.tables.table_forms import table_form
from palpate_records.tables.table_records import pages_of, record_named
from palpate_records.tables.table_rows import rows_below
from palpate_records.tables.table_text import bounded_lines, open_text

from palpate_logs.csv_settings import CsvSettings
from palpate_logs.sample_hold import SampleHold

_SECOND = 1_000_000_000  # [ns]
_BLOCK = 4096  # rows in one batch


class CsvLink:
    """A table that is read."""

    def __init__(self, log: CsvSettings) -> None:
        self._log, self._dialect = log, log.dialect
        self._record = None if log.record is None else record_named(log.file, log.record, log.written)
        self._header = log.header if self._record is None else self._record.header or log.header
        self._sheet = log.sheet if self._record is None else self._record.sheet or log.sheet
        wanted = [(column.column, si_unit(column.unit)[1] * column.scale) for column in log.columns.values()]
        self._clock = log.time is not None and log.time.unit == CLOCK  # in the last of the requested columns
        if log.time is not None:
            second = 1.0 if self._clock else to_si(f"1 {log.time.unit}", "s")
            if log.time.nanoseconds is not None:
                wanted.append((log.time.nanoseconds, 1e-9))
            wanted.append((log.time.column, second * log.time.scale))
        self._wanted = [column for column, _ in wanted]
        self._units = [column.unit for column in log.columns.values()]  # of the first of the requested columns
        self._units += ["s"] if log.time is not None and log.time.nanoseconds is not None else []
        self._units += [log.time.unit] if log.time is not None else []
        self._scales = np.array([scale for _, scale in wanted])
        self._layout = TableLayout(0, 0)
        self._at: list[int] = []  # places of the requested columns
        self._widths = 0, 0, 0  # cells of the longest line, of the latest one, and its number

    def batches(self) -> Iterator[Batch]:
        """Yield the rows of the file in order, some thousand at a time."""
        row, day, first, held = 0, Days(), None, SampleHold()
        self._log.tally.timeless, self._log.tally.overload, self._log.tally.cut = 0, 0, None
        for numbers in self._whole():
            with np.errstate(over="ignore"):  # what is not finite counts as invalid
                values = numbers * self._scales
            if self._log.time is None:
                assert self._log.rate is not None
                stamps = np.rint((row + np.arange(len(values))) * (_SECOND / self._log.rate)).astype(np.int64)
            else:
                seconds, values = values[:, -1], values[:, :-1]
                if self._log.time.nanoseconds is not None:
                    seconds, values = seconds + values[:, -1], values[:, :-1]
                seconds = day.unwrapped(seconds) if self._clock else seconds
                known = np.isfinite(seconds) & (np.abs(seconds) < LATEST)
                self._log.tally.timeless += int(np.count_nonzero(~known))
                values, stamps = values[known], nanoseconds(seconds[known])
            row += len(numbers)
            first = int(stamps[0]) if first is None and len(stamps) else first
            kept = self._within(stamps - (first or 0))
            stamps, values = stamps[kept], held.without_repeats(values[kept])
            yield Batch("", stamps, stamps, sensible(values))
        if row == 0:
            raise LogError(f"{self._log.file}: the file contains no rows of numbers")
        self._log.tally.held = {
            name: rows for name, rows in zip(self._log.columns, held.rows, strict=False) if rows > 1
        }

    def _within(self, since: NDArray[np.int64]) -> NDArray[np.bool_] | slice:
        """Which rows are of the requested part, by their time since the first [ns]."""
        begin, end = self._log.begin, self._log.end
        if begin is None and end is None:
            return slice(None)
        low, high = (None if time is None else round(time * _SECOND) for time in (begin, end))
        return (since >= (low or 0)) & (since <= (since if high is None else high))

    def _whole(self) -> Iterator[Floats]:
        """Yield the numbers (n, places) of all rows but one that was cut."""
        latest = None
        for numbers in self._blocks():
            if latest is not None:
                yield latest
            latest = numbers
        if latest is None:
            return
        last = self._layout.width - 1 in self._at and not self._clock
        cut = cut_number(self._log.file, self._dialect.delimiter, self._dialect.decimal) if last else None
        self._log.tally.cut = cut
        yield latest if cut is None else latest[:-1]

    def _blocks(self) -> Iterator[Floats]:
        log, path = self._log, self._log.file
        with open_text(path, log.encoding, self._sheet) as file:
            lines = first_lines(file, path, self._header or 0)
            stated = self._dialect, self._header, log.units
            self._layout = table_form(lines, stated, lambda: (self._dialect, layout_of(path, lines, *stated)))[1]
            if self._record is not None:
                self._layout = self._record.layout(self._layout)
            self._at = self._places()
            self._check_units()
            file.seek(0)
            line = sum(1 for _ in islice(bounded_lines(file, path), self._layout.begin))  # the last that was read
            for text in whole_lines(file):
                numbers = self._plain(text)
                if numbers is None:  # anything else than plain numbers is read line by line from there on
                    yield from self._by_line(lines_from(text, file, path), line - self._layout.begin)
                    break
                line += len(numbers)
                self._widths = self._layout.width, self._layout.width, line
                yield numbers
            self._refuse_cut()

    def _plain(self, text: str) -> Floats | None:
        """Return the numbers (n, places) of whole lines of nothing but numbers; None for other lines."""
        if self._record is not None or self._clock or max(self._at, default=0) >= self._layout.width:
            return None
        numbers = plain_numbers(text, self._dialect, self._layout.width)
        return None if numbers is None else numbers[:, self._at]

    def _by_line(self, lines: Iterator[str], above: int) -> Iterator[Floats]:
        """Yield the numbers (n, places) of lines that may hold anything; so many rows were read above them."""
        tally = self._log.tally
        tally.footer.clear()
        tally.events.clear()
        rows = rows_below(above, lines, self._layout, self._dialect, self._record, self._pages, tally.footer)
        while part := list(islice(rows, _BLOCK)):
            complete: list[TableRow] = []
            for line, cells in part:
                # Where rows have a time, what a line of words may have lost is a gap.
                if self._log.time is not None and is_event(cells, self._layout.width, self._dialect):
                    tally.events.append(cells[0])
                elif cells:
                    self._check_width(cells, line)
                    complete.append((line, cells))
            if complete:
                yield self._numbers(complete)

    def _pages(self) -> int:
        """Tables under each other through which the record goes on; 0 where those below do not belong to it."""
        if self._record is not None and self._record.header is not None:
            return self._record.pages
        pages = pages_of(self._log.file, self._log.written)
        return pages if pages > 1 or self._header else 0

    def _check_width(self, cells: list[str], line: int) -> None:
        """Refuse a line with more cells than the first: what is behind the one too many is in the wrong column."""
        count, width = len(cells), self._layout.width
        self._widths = max(self._widths[0], count), count, line
        if count > width and any(cell.strip() for cell in cells[width:]):
            self._refuse_commas(cells, line)
            raise LogError(
                f"{self._log.file}:{line}: the line has {count} cells, the first one {width}: its "
                "numbers would be in the wrong columns"
            )

    def _refuse_cut(self) -> None:
        """A last line with fewer cells than the others was not written to its end, nor was its last number."""
        whole, last, line = self._widths
        if last < whole:
            raise LogError(
                f"{self._log.file}:{line}: the last line has {last} of {whole} cells, so the file was cut there; "
                "remove that line to read the others"
            )

    def _places(self) -> list[int]:
        """Where the requested columns are, by their numbers or by their names in the header."""
        names = [*(self._layout.names or ())]
        places = []
        for column in self._wanted:
            if isinstance(column, int):
                places.append(column)
                continue
            if column not in names:
                column = column.lstrip("".join(MARKS)).strip()
            if names.count(column) != 1:
                known = ", ".join(names) if names else "its first line contains numbers"
                many = "two columns" if column in names else "no column"
                raise LogError(f"{self._log.file}: {many} of the name {column!r} ({known})")
            places.append(names.index(column))
        return places

    def _check_units(self) -> None:
        """Refuse units that are not those of the file's own row of units."""
        time = self._log.time
        split = [None] if time is not None and time.nanoseconds is not None else []
        given = [*self._log.columns.values(), *split, *([time] if time else [])]
        for column, place in zip(given, self._at, strict=True):
            if column is None:  # nanoseconds have no unit of their own
                continue
            written = self._layout.units[place] if place < len(self._layout.units) else ""
            if self._log.units == 0 or column.scale != 1.0 or column.unit == CLOCK:
                continue
            try:
                theirs = si_unit(weight_of(written) or written)
            except ValueError:
                continue
            if theirs != si_unit(column.unit):
                raise LogError(
                    f"{self._log.file}:{self._layout.units_line}: the row of units says {written!r} for column "
                    f"{column.column!r}, and not {column.unit!r}; units = 0 lets this be"
                )

    def _refuse_commas(self, cells: list[str], line: int) -> None:
        if is_cut_at_commas(cells, self._layout.names, self._dialect.delimiter):
            few = len(self._layout.names or ())
            advice = "write the numbers with points, or another separator"
            problem = f"{len(cells)} cells under a header of {few}: these look like decimal commas; {advice}"
            raise LogError(f"{self._log.file}:{line}: {problem}")

    def _numbers(self, complete: list[TableRow]) -> Floats:
        """Return the numbers (n, places) of lines: at once where all cells look like numbers, else one by one."""
        with suppress(ValueError, IndexError):
            texts = [cells[place] for _, cells in complete for place in self._at]
            if self._dialect == type(self._dialect)(self._dialect.delimiter, comment=self._dialect.comment) and (
                not without_digits("".join(texts)).strip(" ")
            ):
                return np.array([float(text) for text in texts]).reshape(len(complete), len(self._at))
        last = len(self._at) - 1
        return np.array(
            [
                [
                    self._number(cells, place, line, self._units[k], self._clock and k == last)
                    for k, place in enumerate(self._at)
                ]
                for line, cells in complete
            ]
        )

    def _number(self, cells: list[str], place: int, line: int, unit: str, clock: bool) -> float:
        if place >= len(cells):
            if len(cells) == 1 and not self._dialect.is_value(cells[0]):
                raise LogError(f"{self._log.file}:{line}: {cells[0].strip()[:40]!r} is not a row of numbers")
            there = f"the line has {len(cells)}, 0 to {len(cells) - 1}"
            raise LogError(f"{self._log.file}:{line}: no column {place}; {there}")
        text = cells[place].strip()
        try:
            if clock:
                return seconds_of_day(text) if text else np.nan
            plain, own = number_and_unit(text)
            factor = cell_factor(own, unit) if own else 1.0
            return number(plain, self._dialect.decimal, self._dialect.thousands) * factor if text else np.nan
        except ValueError as error:
            if is_overload(text):
                self._log.tally.overload += 1
                return np.nan
            comma = not clock and self._dialect.decimal == "." and has_decimal_comma(text)
            advice = f"; a decimal comma? {POINTS}" if comma else ""
            kind = "time of day" if clock else "number"
            problem = f"column {place} holds {text!r}, which is not a {kind}{advice}"
            raise LogError(f"{self._log.file}:{line}: {problem}") from error
