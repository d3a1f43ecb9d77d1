"""Times of day in a table."""

from __future__ import annotations

import re

import numpy as np
from palpate import Floats

CLOCK = "clock"  # the unit of a time of day
_DAY = 86_400.0  # [s]
_CLOCK = re.compile(
    r"(?:(?P<days>\d+) days? |\S+[ T])?(?P<hours>\d{1,2}):(?P<minutes>\d{2})(?::(?P<seconds>\d{2}(?:[.,:]\d+)?))?"
    r"(?:\s*(?P<half>[AP])\.?M\.?)?(?:Z|[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)
_NOON = 12  # [h]


def seconds_of_day(cell: str) -> float:
    """The time of day in a cell [s], with or without a date before it, or a duration with its days; raises ValueError.

    >>> seconds_of_day("2024-05-01 12:00:00,25"), seconds_of_day("1:02 PM"), seconds_of_day("1 days 00:00:01.5")
    (43200.25, 46920.0, 86401.5)
    """
    match = _CLOCK.fullmatch(cell.strip())
    if match is None:
        raise ValueError(cell)
    hours, minutes = int(match["hours"]), int(match["minutes"])
    seconds = float(re.sub("[,:]", ".", match["seconds"])) if match["seconds"] else 0.0
    if match["half"]:
        hours = hours % _NOON + (_NOON if match["half"].upper() == "P" else 0)
    if hours > 24 or minutes > 59 or seconds >= 61:
        raise ValueError(cell)
    return _DAY * int(match["days"] or 0) + 3600.0 * hours + 60.0 * minutes + seconds


def seconds_or_nan(cell: str) -> float:
    """Return the time of day in a cell [s]; NaN for any other cell."""
    try:
        return seconds_of_day(cell)
    except ValueError:
        return float("nan")


class Days:
    """Times of day that go on past midnight."""

    def __init__(self) -> None:
        self._latest, self._days = 0.0, 0

    def unwrapped(self, seconds: Floats) -> Floats:
        """Times (n,) [s] since the first midnight."""
        good = np.flatnonzero(np.isfinite(seconds))
        if not good.size:
            return seconds
        steps = np.diff(seconds[good], prepend=self._latest)
        days = self._days + np.cumsum(steps < -0.5 * _DAY)
        self._latest, self._days = float(seconds[good[-1]]), int(days[-1])
        whole = seconds.copy()
        whole[good] += _DAY * days
        return whole
