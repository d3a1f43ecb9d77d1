"""The contents of a table: its rows, their rate, and the likely roles of its columns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, LogError
from palpate_kit.logs.suggestion import find_roles
from palpate_records.field_statistics import FieldStatistics
from palpate_records.messages.readings import LATEST, SECOND, nanoseconds, si_unit
from palpate_records.recording import Survey, TopicSurvey
from palpate_records.tables.clock_times import CLOCK
from palpate_records.tables.csv_layout import facts_worth_stating
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.csv_truncation import cut_number
from palpate_records.tables.table_records import records_note

from palpate_logs.csv_roles import SheetReading, read_sheet

_GAP_RATIO = 10.0  # of an interval to the usual one, from which on it is a gap: that of any survey


def survey_csv(path: Path) -> Survey:
    """Return the contents of a CSV file: its rows, their rate, and the likely roles of its columns."""
    reading = read_sheet(path, {})
    sheet, clock = reading.sheet, reading.clock
    statistics = FieldStatistics(_column_labels(reading))
    row_count = 0
    for block in sheet.blocks():
        row_count += len(block)
        statistics.add(block)
    header = "a header" if sheet.header else "no header"
    topic = TopicSurvey(
        path.name,
        type=f"{len(sheet.names)} columns, {header}, {sheet.dialect.delimiter!r} between",
        encoding="csv",
        messages=row_count,
        first=0,
        last=0,
        fields=statistics.names,
    )
    notes = _notes(path, sheet, has_time=clock is not None)
    if clock is not None:
        topic = _with_times(topic, nanoseconds(clock.seconds[np.abs(clock.seconds) < LATEST]))
    return Survey(path, "CSV", (replace(topic, numbers=statistics.surveys()),), notes)


def _column_labels(reading: SheetReading) -> list[str]:
    """Return the name of each column, with its likely role as in "Fz (force?)"."""
    guess = find_roles(reading.series(), {})
    roles: dict[int, str] = {}
    if guess is not None:
        roles = {int(pick.series.key[1]): role for role, pick in guess.picks.items()}
    if reading.clock is not None and reading.clock.column is not None:
        roles[reading.clock.column] = "time"
    names = enumerate(reading.sheet.names)
    return [f"{name} ({roles[index]}?)" if index in roles else name for index, name in names]


def _notes(path: Path, sheet: Sheet, has_time: bool) -> tuple[str, ...]:
    """Return sentences on a time that is missing, a cut file, other records in it, and facts above the numbers."""
    notes: list[str] = []
    if not has_time:
        notes.append("no column is the time: give the rate, --rate '500 Hz', or the column, --time")
    cut = cut_number(path, sheet.dialect.delimiter, sheet.dialect.decimal)
    if cut is not None:
        notes.append(
            f"the file was cut within its last number, {cut}: its line has no end, all numbers above have more digits"
        )
    other_records = records_note(path, {})
    if other_records is not None:
        notes.append(other_records)
    notes += (f"line {fact.line}: {fact.name}: {fact.value}" for fact in facts_worth_stating(sheet.facts))
    return tuple(notes)


def _with_times(topic: TopicSurvey, stamps: NDArray[np.int64]) -> TopicSurvey:
    """Return a topic with the span, intervals and gaps of its time-stamps (n,) [ns]."""
    intervals = np.diff(np.sort(stamps)).astype(np.float64) / SECOND
    low, median, high = 0.0, 0.0, 0.0
    if len(intervals):
        low, median, high = np.percentile(intervals, (1, 50, 99)).tolist()
    return replace(
        topic,
        first=int(stamps.min()),
        last=int(stamps.max()),
        interval=(low, median, high),
        gaps=int(np.count_nonzero(intervals > _GAP_RATIO * median)),
        longest=float(intervals.max(initial=0.0)),
    )


def tables_csv(path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
    """Yield the name of the table, those of its columns, and its rows that have a time, in blocks, as recorded.

    The number of rows without a time is added to the notes. Raises LogError if no column is the time.
    """
    reading = read_sheet(path, {})
    sheet, clock = reading.sheet, reading.clock
    if clock is None or clock.column is None:
        raise LogError(f"{path}: no column is the time (there are: {sheet.columns})")
    unit = sheet.unit(clock.column) or "s"
    if "time" in clock.setting:
        unit = str(clock.setting["time"]["unit"])
    elif clock.column in sheet.layout.clocks:
        unit = CLOCK
    scale = 1.0 if unit == CLOCK else si_unit(unit)[1]  # a time of day is read in seconds
    untimed_count = 0
    for block in sheet.blocks():
        with np.errstate(invalid="ignore", over="ignore"):  # a time that is not finite, or too large to be one
            is_timed = np.abs(block[:, clock.column] * scale) < LATEST
        untimed_count += int(np.count_nonzero(~is_timed))
        stamps = nanoseconds(block[is_timed, clock.column] * scale)
        yield path.name, sheet.names, Batch(path.name, stamps, stamps, block[is_timed])
    if untimed_count and notes is not None:
        notes.append(f"{untimed_count} rows have no finite time, and were left out")
