"""Replay of a CSV log."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from palpate import Batch, Channel, File, Floats, Frequency, Link, LogError, Settings, Stream, is_number, to_si
from palpate_kit.logs.log_files import regular
from palpate_kit.logs.log_link import file_facts
from palpate_kit.logs.readings import LATEST, nanoseconds, sensible, si_unit
from palpate_kit.logs.recording import Recording, Suggestion, Survey
from pydantic import Field, model_validator
from pydantic_core import from_json

from palpate_logs.csv_cells import POINTS, has_decimal_comma, is_cut_at_commas, number
from palpate_logs.csv_roles import suggest_csv, survey_csv, tables_csv
from palpate_logs.csv_sheet import SUFFIXES, bounded_lines, open_text
from palpate_logs.csv_truncation import cut_number

_SECOND = 1_000_000_000  # [ns]
_BLOCK = 4096  # rows in one batch
_CHARACTERS, _LONGEST = 1 << 17, 100_000  # read at once; and to the end of the last line
_OF_NUMBERS = str.maketrans("", "", "0123456789+-.eE")  # takes away what a number is made of


class Column(Settings):
    """One column of the file."""

    column: Annotated[int, Field(ge=0)] | Annotated[str, Field(min_length=1)] = Field(
        description="column: counted from 0, or its name in the header line"
    )
    unit: str = Field(min_length=1, description='unit of its numbers, such as "mm" or "N"')


@dataclass
class Tally:
    """What was left out of a file."""

    timeless: int = 0  # rows
    cut: str | None = None  # the last number, where the file ends within it


class CsvReplay(Recording):
    """A CSV file of numbers, plain or gzipped, as a device: its columns are channels of one stream.

    Time comes from a column, or from a rate. Columns are counted, or named by the header line. A cell that is empty or
    not finite counts as an invalid reading; text in a column that is used is a mistake of the file and refused, decimal
    commas among it.
    """

    file: File = Field(description="the log, .csv or .csv.gz, relative to the pipeline file")
    columns: dict[str, Column] = Field(min_length=1, description="channels by name: { column = 0, unit = 'mm' }")
    rate: Frequency | None = Field(default=None, gt=0, description="sampling rate, where no column is the time")
    time: Column | None = Field(default=None, description="the column of the time: { column = 0, unit = 's' }")
    delimiter: str = Field(
        default=",", min_length=1, max_length=1, description='separator of the columns: ",", ";", "\\t"'
    )

    @model_validator(mode="after")
    def _one_source_of_time(self) -> Self:
        if (self.rate is None) == (self.time is None):
            raise ValueError('give either rate = "500 Hz" or time = { column = 0, unit = "s" }')
        if self.time is not None:
            to_si(f"1 {self.time.unit}", "s")
        for column in self.columns.values():
            si_unit(column.unit)
        return self

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream without a name: channels are addressed as ``device.channel``."""
        regular(self.file)
        channels = tuple(Channel(name, si_unit(column.unit)[0]) for name, column in self.columns.items())
        return (Stream("", channels, self.rate, clock="file"),)

    @property
    def warnings(self) -> tuple[str, ...]:
        """How many rows were left out since they have no time, and a last one that was cut."""
        tally, found = self.tally, []
        if tally.timeless:
            found.append(f"{self.file.name}: {tally.timeless} rows have no finite time, and were left out")
        if tally.cut is not None:
            found.append(
                f"{self.file.name}: the last line has no end, and its last number, {tally.cut}, fewer digits than all "
                "above: it was cut and is left out"
            )
        return tuple(found)

    @cached_property
    def tally(self) -> Tally:
        """What is counted while the file is read."""
        return Tally()

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        return file_facts(self.file, [self.file])

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The open file."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        yield _CsvLink(self)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """A file that is named like a table of numbers."""
        return path.is_file() and path.name.endswith(SUFFIXES)

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`."""
        return survey_csv(path)

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`; columns are chosen by their name or number, and ``rate`` or ``time`` gives the time."""
        return suggest_csv(path, choices)

    @classmethod
    def tables(cls, path: Path) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`."""
        return tables_csv(path)


class _CsvLink:
    def __init__(self, log: CsvReplay) -> None:
        self._log = log
        wanted = [(column.column, si_unit(column.unit)[1]) for column in log.columns.values()]
        if log.time is not None:
            wanted.append((log.time.column, to_si(f"1 {log.time.unit}", "s")))
        self._wanted = [column for column, _ in wanted]
        self._scales = np.array([scale for _, scale in wanted])
        self._header: list[str] | None = None
        self._at: list[int] | None = None  # places of the wanted columns
        self._begun = False  # whether the header, if there is one, has been read
        self._width = 0  # cells of the first line
        self._widths = 0, 0, 0  # cells of the longest line, of the latest one, and its number

    def batches(self) -> Iterator[Batch]:
        """The rows of the file in order, some thousand at a time."""
        row = 0
        self._log.tally.timeless, self._log.tally.cut = 0, None
        for numbers in self._whole():
            with np.errstate(over="ignore"):  # what is not finite counts as invalid
                values = numbers * self._scales
            if self._log.time is None:
                assert self._log.rate is not None
                stamps = np.rint((row + np.arange(len(values))) * (_SECOND / self._log.rate)).astype(np.int64)
            else:
                seconds, values = values[:, -1], values[:, :-1]
                known = np.isfinite(seconds) & (np.abs(seconds) < LATEST)
                self._log.tally.timeless += int(np.count_nonzero(~known))
                values, stamps = values[known], nanoseconds(seconds[known])
            row += len(numbers)
            yield Batch("", stamps, stamps, sensible(values))
        if row == 0:
            raise LogError(f"{self._log.file}: the file contains no rows of numbers")

    def _whole(self) -> Iterator[Floats]:
        """The numbers (n, places) of all rows but one that was cut."""
        latest = None
        for numbers in self._blocks():
            if latest is not None:
                yield latest
            latest = numbers
        if latest is None:
            return
        cut = cut_number(self._log.file, self._log.delimiter) if self._width - 1 in (self._at or ()) else None
        self._log.tally.cut = cut
        yield latest if cut is None else latest[:-1]

    def _blocks(self) -> Iterator[Floats]:
        path = self._log.file
        with open_text(path) as file:
            line = 0  # the last that was read
            while text := file.read(_CHARACTERS) + file.readline(_LONGEST):
                numbers = self._plain(text)
                if numbers is None:  # anything else than plain numbers is read line by line from there on
                    lines = chain(bounded_lines(io.StringIO(text, newline=""), path), bounded_lines(file, path))
                    yield from self._by_line(enumerate(csv.reader(lines, delimiter=self._log.delimiter), line + 1))
                    break
                line += len(numbers) + (self._header is not None and not self._begun)
                self._begun = True
                self._widths = self._width, self._width, line
                yield numbers
            self._refuse_cut()

    def _plain(self, text: str) -> Floats | None:
        """The numbers (n, places) of whole lines of nothing but numbers, under a header or not; None for other lines.

        What is left without the characters of numbers must be the same separators in every line.
        """
        comma = self._log.delimiter
        text = text.replace("\r\n", "\n") if "\r" in text else text
        if self._at is None:
            first, _, rest = text.partition("\n")
            if not first.strip() or '"' in text:
                return None
            cells = first.split(comma)
            self._at, self._width = self._places(cells), len(cells)
            text = rest if self._header is not None else text
        text = text.removesuffix("\n")
        count = text.count("\n") + 1
        separators = ("\n" + comma * (self._width - 1)) * count
        if not text or text.translate(_OF_NUMBERS) != separators[1:]:
            return None
        found = _parsed((text if comma == "," else text.replace(comma, ",")).replace("\n", ","))
        if found is None:
            return None
        whole = found.size == count * self._width and max(self._at, default=0) < self._width
        return found.reshape(count, self._width)[:, self._at] if whole else None

    def _by_line(self, rows: Iterator[tuple[int, list[str]]]) -> Iterator[Floats]:
        """The numbers (n, places) of lines that may hold anything."""
        while lines := list(islice(rows, _BLOCK)):
            complete: list[tuple[int, list[str]]] = []
            for line, cells in lines:
                if not cells:
                    continue
                if self._at is None:
                    self._at = self._places(cells)
                    self._width = len(cells)
                if self._header is not None and not self._begun:
                    self._begun = True
                    continue
                self._check_width(cells, line)
                complete.append((line, cells))
            if complete and self._at is not None:
                yield self._numbers(complete, self._at)

    def _check_width(self, cells: list[str], line: int) -> None:
        """Refuse a line with more cells than the first: what is behind the one too many is in the wrong column."""
        count = len(cells)
        self._widths = max(self._widths[0], count), count, line
        if count > self._width and any(cell.strip() for cell in cells[self._width :]):
            self._refuse_commas(cells, line)
            raise LogError(
                f"{self._log.file}:{line}: the line has {count} cells, the first one {self._width}: its "
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

    def _places(self, cells: list[str]) -> list[int]:
        """Where the wanted columns are, by the first line, which is a header where none of it is a number."""
        if not any(is_number(cell) for cell in cells):
            self._header = [cell.strip().lstrip("\ufeff") for cell in cells]
        names = self._header or []
        places = []
        for column in self._wanted:
            if isinstance(column, str) and names.count(column) != 1:
                known = ", ".join(names) if names else "its first line contains numbers"
                many = "two columns" if column in names else "no column"
                raise LogError(f"{self._log.file}: {many} of the name {column!r} ({known})")
            places.append(names.index(column) if isinstance(column, str) else column)
        return places

    def _refuse_commas(self, cells: list[str], line: int) -> None:
        if is_cut_at_commas(cells, self._header, self._log.delimiter):
            few = len(self._header or ())
            problem = f"{len(cells)} cells under a header of {few}: these look like decimal commas; {POINTS}"
            raise LogError(f"{self._log.file}:{line}: {problem}")

    def _numbers(self, complete: list[tuple[int, list[str]]], places: list[int]) -> Floats:
        """The numbers (n, places) of lines: at once where all cells look like numbers, else one by one."""
        with suppress(ValueError, IndexError):
            texts = [cells[place] for _, cells in complete for place in places]
            if not "".join(texts).translate(_OF_NUMBERS).strip(" "):
                return np.array([float(text) for text in texts]).reshape(len(complete), len(places))
        return np.array([[self._number(cells, place, line) for place in places] for line, cells in complete])

    def _number(self, cells: list[str], place: int, line: int) -> float:
        if place >= len(cells):
            there = f"the line has {len(cells)}, 0 to {len(cells) - 1}"
            raise LogError(f"{self._log.file}:{line}: there is no column {place}; {there}")
        text = cells[place].strip()
        try:
            return number(text) if text else np.nan
        except ValueError as error:
            advice = f"; a decimal comma? {POINTS}" if has_decimal_comma(text) else ""
            problem = f"column {place} holds {text!r}, which is no number{advice}"
            raise LogError(f"{self._log.file}:{line}: {problem}") from error


def _parsed(numbers: str) -> Floats | None:
    """The numbers (n,) between commas; None where they are none."""
    try:  # a reader of JSON, which has the same numbers but for +1, .5 and 1., takes a third of the time
        found = from_json(f"[{numbers}]")
        return np.fromiter(found, np.float64, len(found))
    except (ValueError, OverflowError):
        pass
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # text that does not end as a number
        try:
            return np.fromstring(numbers, sep=",")
        except (DeprecationWarning, ValueError):
            return None
