"""Times of day in a table."""

from __future__ import annotations

import re

import numpy as np
from palpate import Floats

CLOCK = "clock"  # the unit of a time of day
_MINUTE, _HOUR, _DAY = 60.0, 3600.0, 86_400.0  # [s]
_CLOCK = re.compile(
    r"(?:(?P<days>\d+) days? |\S+[ T])?(?P<hours>\d{1,2}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}(?:[.,:]\d+)?))?"
    r"(?:\s*(?P<half>[AP])\.?M\.?)?(?:Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)
_NOON = 12  # [h]


def seconds_of_day(cell: str) -> float:
    """Return the time of day in a cell [s], with or without a date, or a duration with its days; raises ValueError.

    >>> seconds_of_day("2024-05-01 12:00:00,25"), seconds_of_day("1:02 PM"), seconds_of_day("1 days 00:00:01.5")
    (43200.25, 46920.0, 86401.5)
    """
    match = _CLOCK.fullmatch(cell.strip())
    if match is None:
        raise ValueError(cell)
    hours = int(match["hours"])
    minutes = int(match["minutes"])
    seconds = float(re.sub("[,:]", ".", match["seconds"])) if match["seconds"] else 0.0
    if match["half"]:
        hours = hours % _NOON + (_NOON if match["half"].upper() == "P" else 0)
    if hours > 24 or minutes > 59 or seconds >= 61:  # 24:00 is midnight, and second 60 a leap second
        raise ValueError(cell)
    return _DAY * int(match["days"] or 0) + _HOUR * hours + _MINUTE * minutes + seconds


def seconds_or_nan(cell: str) -> float:
    """Return the time of day in a cell [s]; NaN for any other cell."""
    try:
        return seconds_of_day(cell)
    except ValueError:
        return float("nan")


class Days:
    """The day of each time of day in a column, which grows at each midnight."""

    def __init__(self) -> None:
        self._latest = 0.0  # [s] time of day of the last row
        self._days = 0

    def unwrapped(self, seconds: Floats) -> Floats:
        """Return times (n,) [s] since the first midnight for times of day (n,) [s]; they go on from earlier blocks.

        A fall by more than half a day is a midnight; a smaller one is a clock that was set back.
        """
        finite_rows = np.flatnonzero(np.isfinite(seconds))
        if not finite_rows.size:
            return seconds
        steps = np.diff(seconds[finite_rows], prepend=self._latest)  # from the last time of the block before
        days = self._days + np.cumsum(steps < -0.5 * _DAY)
        self._latest = float(seconds[finite_rows[-1]])
        self._days = int(days[-1])
        times = seconds.copy()
        times[finite_rows] += _DAY * days
        return times
