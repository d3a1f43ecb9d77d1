"""Which column of a CSV file is the time, and in which unit."""

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

RATES = (20.0, 5000.0)  # [Hz] of a recording, by which the unit of a time without one is found
_MIN_SECONDS = 3  # that begin within a record, for its rows to be counted
_MIN_SHARE = 3  # rows that share a second; of two that are alike one was written twice
_UNEVEN = 0.1  # of the rows in a second, by which the next may have more or fewer
_OTHER_ROLES = ("force", "position", "velocity")  # of columns that are not the time, however evenly they grow
_ALIKE = 0.2  # share of the rows with the stamp of the row before, above which a clock is too coarse


@dataclass(frozen=True)
class TimeColumn:
    """Where the time of a row comes from."""

    seconds: Floats  # (n,)
    setting: Mapping[str, Any] = field(default_factory=dict)  # of the device
    reason: str = ""
    column: int | None = None
    sure: bool = True
    note: str = ""  # what a person must know of it


def clock_of(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int] = ()) -> TimeColumn | None:
    """The time of a file's rows: by a column, as chosen, by its name or since it grows evenly, else by a rate, or None.

    It is not one of the columns that are taken for something else. A rate is for files without a time: it would shift
    every reading of one that has gaps, or runs at another rate.
    """
    found = _clock_column(sheet, values, choices, taken)
    if "rate" in choices and not (found is not None and "time" in found.setting and _advances(found.seconds)):
        try:
            rate = to_si(choices["rate"], "Hz")
        except ValueError as error:
            raise LogError(f"{sheet.path}: --rate: {error}") from error
        return TimeColumn(np.arange(len(values)) / rate, {"rate": choices["rate"]}, "chosen")
    return found


def _advances(seconds: Floats) -> bool:
    """Return True if a time goes on from most readings to the next."""
    steps = np.diff(seconds[np.isfinite(seconds)])
    return len(steps) > 0 and float(np.median(steps)) > 0.0 and float(np.mean(steps == 0)) <= _ALIKE


def demand_progress(sheet: Sheet, clock: TimeColumn, values: Floats) -> None:
    """Raise LogError where the time of a file's rows does not go on; said before anything about their numbers."""
    steps = np.diff(clock.seconds)
    if clock.column is None or not len(steps):
        return
    name, alike = f"column {sheet.column(clock.column)!r}", steps == 0
    if float(np.mean(alike)) > _ALIKE:
        whole = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        count = f"{int(alike.sum())} of {len(values)} rows have the time of the row before in {name}"
        if float(np.mean(whole[alike].all(axis=1))) > 1.0 - _ALIKE:
            raise LogError(f"{sheet.path}: {count}, and its numbers: the rows are written twice; keep one of each")
        rest = "whole seconds, or otherwise rounded" if not (clock.seconds % 1.0).any() else "rounded"
        raise LogError(f"{sheet.path}: {count}: it is {rest}; state how many rows there are in a second with --rate")
    if float(np.mean(steps < 0)) > 0.5:
        raise LogError(f"{sheet.path}: {name} runs backwards: sort the rows by their time, the first reading first")
    if stamp_parts(sheet.names).get("nano") == clock.column and (steps < 0).any():
        raise LogError(
            f"{sheet.path}: {name} restarts every second, and the seconds are in no column: export those, too, or "
            "name another time with --time"
        )


@dataclass(frozen=True)
class _ClockSearch:
    """The columns that the rules for the time look at."""

    sheet: Sheet
    values: Floats  # (n, columns)
    choices: Mapping[str, str]
    taken: Sequence[int]  # columns that are something else

    @cached_property
    def parts(self) -> Mapping[str, int]:
        """The columns of a stamp in two."""
        return stamp_parts(self.sheet.names)


@rule("--time COLUMN", "the time", Sureness.CHOSEN)
def chosen_time(search: _ClockSearch) -> Sequence[int]:
    """Return the column that a person states; raises LogError where it holds no numbers."""
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
    """Return columns that nothing but their numbers makes a time."""
    names = search.sheet.names
    free = [k for k in range(len(names)) if k not in search.taken and stated_role(names[k]) not in _OTHER_ROLES]
    return [k for k in free if _ticks(search.values[:, k])]


TIME_RULES = (chosen_time, name_begins_as_time, name_has_time, cells_of_clock, even_growth)


def _clock_column(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int]) -> TimeColumn | None:
    """Return the column that is the time by the surest rule; None where none can be it."""
    search = _ClockSearch(sheet, values, choices, taken)
    if "time" not in choices and len(search.parts) == 2:
        return _time_in_two_columns(search)
    sureness: dict[int, Sureness] = {}
    for time_rule in TIME_RULES if "time" not in choices else (chosen_time,):
        for k in time_rule(search):
            sureness.setdefault(k, time_rule.sureness)
    # A column that restarts, as the time of a cycle does, comes last.
    for k in sorted(sureness, key=lambda k: _falls(values[:, k])):
        read = _time_of_day if k in sheet.layout.clocks else _time_in_unit
        if (clock := read(search, k, sureness[k] > Sureness.GUESS)) is not None:
            return clock
    return None


def _time_in_two_columns(search: _ClockSearch) -> TimeColumn:
    """Return the time whose seconds and nanoseconds are in two columns."""
    whole, nano = search.parts["whole"], search.parts["nano"]
    time = {"column": search.sheet.column(whole), "unit": "s", "nanoseconds": search.sheet.column(nano)}
    seconds: Floats = search.values[:, whole] + 1e-9 * search.values[:, nano]
    return TimeColumn(seconds, {"time": time}, "seconds and nanoseconds are in two columns", whole)


def _time_of_day(search: _ClockSearch, k: int, is_named: bool) -> TimeColumn | None:
    """Return the time of a column of times of day; None for ones that stand still."""
    steps = _steps(search.values[:, k])
    if np.mean(steps == 0) > _ALIKE:
        return _even_seconds(search.sheet, k, search.values[:, k])
    rate = f"{1.0 / float(np.mean(steps[steps > 0])):.4g} Hz" if (steps > 0).any() else "one row"
    setting = {"time": {"column": search.sheet.column(k), "unit": CLOCK}}
    return TimeColumn(search.values[:, k], setting, f"time of day: {rate}", k)


def _time_in_unit(search: _ClockSearch, k: int, is_named: bool) -> TimeColumn | None:
    """Return the time of a column in its unit, else in one in which its rate is that of a recording; None for none."""
    sheet, steps = search.sheet, _steps(search.values[:, k])
    usual = float(np.median(steps)) if len(steps) else 0.0
    unit = sheet.unit(k) or next((u for u in ("s", "ms", "us", "ns") if usual > 0 and _plausible(usual, u)), None)
    if unit is None and is_named:
        return _even_seconds(sheet, k, search.values[:, k])
    if unit is None or si_unit(unit)[0] != "s":
        return None
    seconds = search.values[:, k] * si_unit(unit)[1]
    if is_named and (even := _even_seconds(search.sheet, k, seconds)) is not None:
        return even
    reason = f"taken as {unit}: {1.0 / (usual * si_unit(unit)[1]):.4g} Hz" if usual > 0 else f"in {unit}"
    is_sure = is_named or sheet.unit(k) is not None
    return TimeColumn(seconds, {"time": {"column": sheet.column(k), "unit": unit}}, reason, k, is_sure)


def _even_seconds(sheet: Sheet, k: int, seconds: Floats) -> TimeColumn | None:
    """Return the time of rows (n,) that share whole seconds, as evenly as they do; None for any other time."""
    if not np.isfinite(seconds).all():
        return None
    begins = np.flatnonzero(np.diff(seconds)) + 1  # rows with which a second begins
    if len(begins) < _MIN_SECONDS or (seconds % 1.0).any() or (seconds[begins] - seconds[begins - 1] != 1.0).any():
        return None
    counts = np.diff(begins)
    usual = float(np.median(counts))
    ends = max(begins[0], len(seconds) - begins[-1])
    if usual < _MIN_SHARE or np.ptp(counts) > max(2.0, _UNEVEN * usual) or ends > usual + max(2.0, _UNEVEN * usual):
        return None
    rate = float(f"{(begins[-1] - begins[0]) / (len(begins) - 1):.6g}")
    note = f"time: column {sheet.column(k)} has whole seconds; its {rate:g} rows in a second are taken as even"
    return TimeColumn(np.arange(len(seconds)) / rate, {"rate": f"{rate:g} Hz"}, f"{rate:g} Hz", k, note=note)


def _steps(values: Floats) -> Floats:
    """Return the steps between the finite values of a column."""
    return np.diff(values[np.isfinite(values)])


def _falls(values: Floats) -> bool:
    """Return True if a column restarts, as the time of a cycle does."""
    return bool((_steps(values) < 0).any())


def _plausible(step: float, unit: str) -> bool:
    return RATES[0] <= 1.0 / (step * si_unit(unit)[1]) <= RATES[1]


def _ticks(values: Floats) -> bool:
    """Return True if a column always grows, evenly, and does not merely count the rows."""
    steps: Floats = np.asarray(np.diff(values), np.float64)
    return bool(
        len(steps) > 10 and (steps > 0).all() and float(steps.std()) < 0.5 * float(steps.mean()) and (steps != 1).any()
    )
