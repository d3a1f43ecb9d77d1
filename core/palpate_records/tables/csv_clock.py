"""The time of a text table: its column, and the unit of that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats, LogError, to_si

from palpate_records.messages.readings import si_unit
from palpate_records.tables.clock_times import CLOCK
from palpate_records.tables.csv_names import begins_as_time, role_by_words, stamp_parts, stated_role
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.rules import Sureness, rule

# Choices.
RATES = (20.0, 5000.0)  # [Hz] of a recording, by which the unit of a time without one is guessed
_MIN_SECONDS = 3  # that begin within a record, for its rows to be counted
_MIN_ROWS_PER_SECOND = 3  # that share a second; of two that are alike one was written twice
_MAX_UNEVENNESS = 0.1  # of the rows in a second, by which other seconds may have more or fewer
_MAX_ROW_DIFFERENCE = 2.0  # [rows], the same for few rows in a second
_RATE_DIGITS = 6  # of the rate of rows that share whole seconds
_OTHER_ROLES = ("force", "position", "velocity")  # of columns that are not the time, however evenly they grow
_MAX_EQUAL_SHARE = 0.2  # of the rows, with the stamp of the row before, above which a clock is too coarse
_MIN_TICKS = 10  # steps of a column that can be a time by its numbers alone
_MAX_STEP_SCATTER = 0.5  # standard deviation of such steps over their mean
_NANOSECOND = 1e-9  # [s]


@dataclass(frozen=True)
class TimeColumn:
    """The times of the rows of a table, and the settings of the device by which they are read."""

    seconds: Floats  # (n,)
    setting: Mapping[str, Any] = field(default_factory=dict)  # of the device
    reason: str = ""
    column: int | None = None
    sure: bool = True
    note: str = ""  # for the user, on an assumption


def clock_of(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int] = ()) -> TimeColumn | None:
    """Return the time of a file's rows: by a column, else by a chosen rate; None without either.

    The column is chosen, or has the name of a time, or grows evenly; it is not among the `taken` ones. A rate counts
    only for files without a time: it would shift every reading of a file that has gaps, or runs at another rate.
    `sheet` is the text table with names and units of its columns, `values` (n, columns) its numbers, `choices` what a
    person has stated, by key. Raises LogError for a rate that is not one.
    """
    clock = _clock_column(sheet, values, choices, taken)
    has_time = clock is not None and "time" in clock.setting and _advances(clock.seconds)
    if "rate" not in choices or has_time:
        return clock
    try:
        rate = to_si(choices["rate"], "Hz")
    except ValueError as error:
        raise LogError(f"{sheet.path}: --rate: {error}") from error
    return TimeColumn(np.arange(len(values)) / rate, {"rate": choices["rate"]}, "chosen")


def _advances(seconds: Floats) -> bool:
    """Return True if a time goes on from most readings to the next."""
    steps = np.diff(seconds[np.isfinite(seconds)])
    return len(steps) > 0 and float(np.median(steps)) > 0.0 and float(np.mean(steps == 0)) <= _MAX_EQUAL_SHARE


def demand_progress(sheet: Sheet, clock: TimeColumn, values: Floats) -> None:
    """Raise LogError if the time column of a file stands still or runs backwards.

    The column, `clock` with its seconds (n,), is checked before the numbers (n, columns) of the file: any finding on
    these would be wrong.
    """
    steps = np.diff(clock.seconds)
    if clock.column is None or not len(steps):
        return
    name = f"column {sheet.column(clock.column)!r}"
    is_equal = steps == 0
    if float(np.mean(is_equal)) > _MAX_EQUAL_SHARE:
        count = f"{int(is_equal.sum())} of {len(values)} rows have the time of the row before in {name}"
        # Rows whose numbers are those of the row before as well were written twice.
        is_repeated = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        if float(np.mean(is_repeated[is_equal].all(axis=1))) > 1.0 - _MAX_EQUAL_SHARE:
            raise LogError(f"{sheet.path}: {count}, and its numbers: the rows are written twice; keep one of each")
        rounding = "whole seconds, or otherwise rounded" if not (clock.seconds % 1.0).any() else "rounded"
        raise LogError(
            f"{sheet.path}: {count}: it is {rounding}; state how many rows there are in a second with --rate"
        )
    if float(np.mean(steps < 0)) > 0.5:  # most of the steps
        raise LogError(f"{sheet.path}: {name} runs backwards: sort the rows by their time, the first reading first")
    if stamp_parts(sheet.names).get("nano") == clock.column and (steps < 0).any():
        raise LogError(
            f"{sheet.path}: {name} restarts every second, and the seconds are in no column: export those, too, or "
            "name another time with --time"
        )


@dataclass(frozen=True)
class _ClockSearch:
    """A table whose time column the rules look for."""

    sheet: Sheet
    values: Floats  # (n, columns)
    choices: Mapping[str, str]
    taken: Sequence[int]  # columns of other roles

    @cached_property
    def parts(self) -> Mapping[str, int]:
        """The columns of whole seconds and nanoseconds, if a stamp is in two columns."""
        return stamp_parts(self.sheet.names)


@rule("--time COLUMN", "the time", Sureness.CHOSEN)
def chosen_time(search: _ClockSearch) -> Sequence[int]:
    """Return the column that a person states; raises LogError if it holds no numbers."""
    if "time" not in search.choices:
        return ()
    column = search.sheet.index_of("time", search.choices["time"])
    search.sheet.demand_numbers("time", column, search.values[:, column])
    return (column,)


@rule("the first word of a name", "the time", Sureness.STATED)
def name_begins_as_time(search: _ClockSearch) -> Sequence[int]:
    """Return columns such as "Time (s)"."""
    return [k for k, name in enumerate(search.sheet.names) if begins_as_time(name)]


@rule("a word of a name", "the time", Sureness.WORD)
def name_has_time(search: _ClockSearch) -> Sequence[int]:
    """Return columns such as "Elapsed Time"."""
    return [k for k, name in enumerate(search.sheet.names) if role_by_words(name) == "time"]


@rule("cells such as 12:30:01.5", "the time", Sureness.WORD)
def cells_of_clock(search: _ClockSearch) -> Sequence[int]:
    """Return columns of times of day."""
    return sorted(search.sheet.layout.clocks)


@rule("numbers that grow evenly, and do not count the rows", "the time", Sureness.GUESS)
def even_growth(search: _ClockSearch) -> Sequence[int]:
    """Return columns that are a time by their numbers alone."""
    names = search.sheet.names
    free = [k for k in range(len(names)) if k not in search.taken and stated_role(names[k]) not in _OTHER_ROLES]
    return [k for k in free if _ticks(search.values[:, k])]


TIME_RULES = (chosen_time, name_begins_as_time, name_has_time, cells_of_clock, even_growth)


def _clock_column(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int]) -> TimeColumn | None:
    """Return the time column by the surest rule; None without one.

    Each rule yields columns that may be the time; the first that can be read in its unit is taken.
    """
    search = _ClockSearch(sheet, values, choices, taken)
    if "time" not in choices and len(search.parts) == 2:
        return _time_in_two_columns(search)
    sureness: dict[int, Sureness] = {}
    for time_rule in TIME_RULES if "time" not in choices else (chosen_time,):
        for column in time_rule(search):
            sureness.setdefault(column, time_rule.sureness)
    # A column that restarts, as the time of a cycle does, comes last.
    for column in sorted(sureness, key=lambda column: _falls(values[:, column])):
        if column in sheet.layout.clocks:
            clock = _time_of_day(search, column)
        else:
            clock = _time_in_unit(search, column, is_named=sureness[column] > Sureness.GUESS)
        if clock is not None:
            return clock
    return None


def _time_in_two_columns(search: _ClockSearch) -> TimeColumn:
    """Return the time whose seconds and nanoseconds are in two columns."""
    whole, nano = search.parts["whole"], search.parts["nano"]
    time = {"column": search.sheet.column(whole), "unit": "s", "nanoseconds": search.sheet.column(nano)}
    seconds: Floats = search.values[:, whole] + _NANOSECOND * search.values[:, nano]
    return TimeColumn(seconds, {"time": time}, "seconds and nanoseconds are in two columns", whole)


def _time_of_day(search: _ClockSearch, column: int) -> TimeColumn | None:
    """Return the time of a column of times of day; None for one that stands still and has no whole seconds."""
    values = search.values[:, column]
    steps = _steps(values)
    if np.mean(steps == 0) > _MAX_EQUAL_SHARE:
        return _even_seconds(search.sheet, column, values)
    rate = f"{1.0 / float(np.mean(steps[steps > 0])):.4g} Hz" if (steps > 0).any() else "one row"
    setting = {"time": {"column": search.sheet.column(column), "unit": CLOCK}}
    return TimeColumn(values, setting, f"time of day: {rate}", column)


def _time_in_unit(search: _ClockSearch, column: int, is_named: bool) -> TimeColumn | None:
    """Return the time of a column in its unit, else in the first unit in which its rate is that of a recording.

    `search` has the sheet and its numbers (n, columns); `is_named` says that something states the column to be the
    time. None for a column in a unit of anything else than time, and for one without a unit in which its rate is usual.
    """
    sheet, values = search.sheet, search.values[:, column]
    steps = _steps(values)
    usual_step = float(np.median(steps)) if len(steps) else 0.0
    stated_unit = sheet.unit(column)
    unit = stated_unit or _likely_unit(usual_step)
    if unit is None:
        return _even_seconds(sheet, column, values) if is_named else None
    dimension, unit_size = si_unit(unit)
    if dimension != "s":
        return None
    seconds = values * unit_size
    # Whole seconds that rows share are coarse; even rows are a better time.
    if is_named and (even_clock := _even_seconds(sheet, column, seconds)) is not None:
        return even_clock
    reason = f"taken as {unit}: {1.0 / (usual_step * unit_size):.4g} Hz" if usual_step > 0 else f"in {unit}"
    setting = {"time": {"column": sheet.column(column), "unit": unit}}
    return TimeColumn(seconds, setting, reason, column, sure=is_named or stated_unit is not None)


def _likely_unit(step: float) -> str | None:
    """Return the first unit of time in which a step between rows is that of a recording; None for none."""
    if step <= 0:
        return None
    return next((unit for unit in ("s", "ms", "us", "ns") if _is_usual_step(step, unit)), None)


def _even_seconds(sheet: Sheet, column: int, seconds: Floats) -> TimeColumn | None:
    """Return the time of rows (n,) that share whole seconds, as evenly as they do; None for any other time."""
    if not np.isfinite(seconds).all():
        return None
    begins = np.flatnonzero(np.diff(seconds)) + 1  # rows with which a second begins
    if len(begins) < _MIN_SECONDS or (seconds % 1.0).any() or (seconds[begins] - seconds[begins - 1] != 1.0).any():
        return None
    # Every whole second has about the same number of rows, and the first and the last second not more.
    counts = np.diff(begins)
    usual_count = float(np.median(counts))
    tolerance = max(_MAX_ROW_DIFFERENCE, _MAX_UNEVENNESS * usual_count)
    largest_end = max(begins[0], len(seconds) - begins[-1])
    if usual_count < _MIN_ROWS_PER_SECOND or np.ptp(counts) > tolerance or largest_end > usual_count + tolerance:
        return None
    rate = float(f"{(begins[-1] - begins[0]) / (len(begins) - 1):.{_RATE_DIGITS}g}")
    note = f"time: column {sheet.column(column)} has whole seconds; its {rate:g} rows in a second are taken as even"
    return TimeColumn(np.arange(len(seconds)) / rate, {"rate": f"{rate:g} Hz"}, f"{rate:g} Hz", column, note=note)


def _steps(values: Floats) -> Floats:
    """Return the steps between the finite values of a column."""
    return np.diff(values[np.isfinite(values)])


def _falls(values: Floats) -> bool:
    """Return True if a column restarts, as the time of a cycle does."""
    return bool((_steps(values) < 0).any())


def _is_usual_step(step: float, unit: str) -> bool:
    """Return True if a step of a time in a unit is one of the usual rates."""
    lowest_rate, highest_rate = RATES
    return lowest_rate <= 1.0 / (step * si_unit(unit)[1]) <= highest_rate


def _ticks(values: Floats) -> bool:
    """Return True if a column always grows, evenly, and does not merely count the rows."""
    steps: Floats = np.asarray(np.diff(values), np.float64)
    if len(steps) <= _MIN_TICKS or not (steps > 0).all():
        return False
    is_even = float(steps.std()) < _MAX_STEP_SCATTER * float(steps.mean())
    return bool(is_even and (steps != 1).any())
