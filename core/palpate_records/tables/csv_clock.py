"""Which column of a CSV file is the time, and in which unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import Floats, LogError, to_si

from palpate_records.messages.readings import si_unit
from palpate_records.tables.clock_times import CLOCK
from palpate_records.tables.csv_names import begins_as_time, role_by_words, stamp_parts
from palpate_records.tables.csv_sheet import Sheet

RATES = (20.0, 5000.0)  # [Hz] of a recording, by which the unit of a time without one is found
_ALIKE = 0.2  # share of the rows with the stamp of the row before, above which a clock is too coarse


@dataclass(frozen=True)
class TimeColumn:
    """Where the time of a row comes from."""

    seconds: Floats  # (n,)
    setting: Mapping[str, Any] = field(default_factory=dict)  # of the device
    reason: str = ""
    column: int | None = None
    sure: bool = True


def clock_of(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int] = ()) -> TimeColumn | None:
    """The time of a file's rows: by a column, as chosen, by its name or since it grows evenly, else by a rate, or None.

    It is not one of the columns that are taken for something else. A rate is for files without a time: it would shift
    every reading of one that has gaps, or runs at another rate.
    """
    found = _clock_column(sheet, values, choices, taken)
    if "rate" in choices and not (found is not None and _advances(found.seconds)):
        try:
            rate = to_si(choices["rate"], "Hz")
        except ValueError as error:
            raise LogError(f"{sheet.path}: --rate: {error}") from error
        return TimeColumn(np.arange(len(values)) / rate, {"rate": choices["rate"]}, "chosen")
    return found


def _advances(seconds: Floats) -> bool:
    """Whether a time goes on from most readings to the next."""
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


def _clock_column(sheet: Sheet, values: Floats, choices: Mapping[str, str], taken: Sequence[int]) -> TimeColumn | None:
    """The column that is the time; None where none can be it."""
    parts = stamp_parts(sheet.names)
    if "time" not in choices and len(parts) == 2:
        whole, nano = parts["whole"], parts["nano"]
        time = {"column": sheet.column(whole), "unit": "s", "nanoseconds": sheet.column(nano)}
        seconds: Floats = values[:, whole] + 1e-9 * values[:, nano]
        return TimeColumn(seconds, {"time": time}, "seconds and nanoseconds are in two columns", whole)
    if "time" in choices:
        columns = [sheet.index_of("time", choices["time"])]
        sheet.demand_numbers("time", columns[0], values[:, columns[0]])
    else:
        columns = [k for k, name in enumerate(sheet.names) if begins_as_time(name)]
        columns += [k for k, name in enumerate(sheet.names) if role_by_words(name) == "time" and k not in columns]
        columns += [k for k in sorted(sheet.layout.clocks) if k not in columns]
    named = len(columns)
    rest = [] if "time" in choices else [k for k in range(len(sheet.names)) if k not in (*columns, *taken)]
    columns += [k for k in rest if _ticks(values[:, k])]
    for i, k in sorted(enumerate(columns), key=lambda pair: _falls(values[:, pair[1]])):
        steps = np.diff(values[np.isfinite(values[:, k]), k])
        usual = float(np.median(steps)) if len(steps) else 0.0
        if k in sheet.layout.clocks:
            if np.mean(steps == 0) > _ALIKE:
                continue  # whole seconds say nothing of what is between
            often = f"{1.0 / float(np.mean(steps[steps > 0])):.4g} Hz" if (steps > 0).any() else "one row"
            setting = {"time": {"column": sheet.column(k), "unit": CLOCK}}
            return TimeColumn(values[:, k], setting, f"time of day: {often}", k)
        unit = sheet.unit(k) or next((u for u in ("s", "ms", "us", "ns") if usual > 0 and _plausible(usual, u)), None)
        if unit is None or si_unit(unit)[0] != "s":
            continue
        seconds = values[:, k] * si_unit(unit)[1]
        reason = f"taken as {unit}: {1.0 / (usual * si_unit(unit)[1]):.4g} Hz" if usual > 0 else f"in {unit}"
        is_stated = i < named or sheet.unit(k) is not None
        return TimeColumn(seconds, {"time": {"column": sheet.column(k), "unit": unit}}, reason, k, is_stated)
    return None


def _falls(values: Floats) -> bool:
    """Whether a column restarts, as the time of a cycle does."""
    return bool((np.diff(values[np.isfinite(values)]) < 0).any())


def _plausible(step: float, unit: str) -> bool:
    return RATES[0] <= 1.0 / (step * si_unit(unit)[1]) <= RATES[1]


def _ticks(values: Floats) -> bool:
    """Whether a column always grows, evenly, and does not merely count the rows."""
    steps: Floats = np.asarray(np.diff(values), np.float64)
    return bool(
        len(steps) > 10 and (steps > 0).all() and float(steps.std()) < 0.5 * float(steps.mean()) and (steps != 1).any()
    )
