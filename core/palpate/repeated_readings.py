"""Equal readings in a row: the repeats of a sound sensor, and those of one that no longer measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.vectors import Floats

_STUCK_SPAN = 0.1  # [s], a choice: a sensor that repeats itself for longer no longer measures
_STUCK_RATIO = 5  # longest runs at standstill, a choice: nor does one before so many
_SUSPECT_SPAN = 0.03  # [s], a choice: in place of `_STUCK_SPAN`, for a run that continues
_MS = 1e3  # per second


@dataclass(frozen=True)
class Repeats:
    """The longest runs of readings that are equal in every digit, with a sound sensor in free air.

    Columns count in groups: all axes together, and each force whose noise exceeds its resolution by itself, because a
    clipped axis stands still while the others go on.
    """

    names: tuple[str, ...]  # of the groups
    groups: tuple[tuple[int, ...], ...]  # columns of the stream
    longest: tuple[int, ...]  # readings in a row, of each group
    rate: float  # [Hz]

    @classmethod
    def of(cls, rows: Floats, rate: float, axes: Mapping[int, str], forces: tuple[int, ...], stream: str) -> Repeats:
        """Return the repeats in readings (n, columns) of a standstill; `axes`: columns by name, `forces` among them."""
        resolved = [column for column in forces if _exceeds_resolution(rows[:, column])]
        names = [f"every axis of {stream}", *(axes[column] for column in resolved)]
        groups = (tuple(axes), *((column,) for column in resolved))
        count = RepeatCount(cls(tuple(names), groups, (0,) * len(groups), rate))
        count.add(rows)
        return cls(tuple(names), groups, tuple(count.longest.tolist()), rate)

    def most(self, span: float) -> Floats:
        """Return the most equal readings in a row (groups,) of a sound sensor, and at least those of a span [s]."""
        return np.maximum(span * self.rate, _STUCK_RATIO * np.array(self.longest, np.float64))


class RepeatCount:
    """Counts equal readings in a row, however the readings are cut into batches."""

    def __init__(self, usual: Repeats, first: int = 0) -> None:
        """Take the usual repeats of a sensor; its columns begin at `first` in the readings to come."""
        self._usual = usual
        self._columns = sorted({first + column for group in usual.groups for column in group})
        self._groups = [[self._columns.index(first + column) for column in group] for group in usual.groups]
        self._stuck, self._suspect = usual.most(_STUCK_SPAN), usual.most(_SUSPECT_SPAN)
        self._previous: Floats | None = None  # the latest reading so far
        self._runs = np.zeros(len(self._groups), np.int64)  # those that continue
        self.longest = self._runs.copy()  # of the latest readings

    def add(self, rows: Floats) -> None:
        """Count readings (n, columns), in their order."""
        if not len(rows):
            return
        rows = rows[:, self._columns]
        previous = np.full((1, rows.shape[1]), np.inf) if self._previous is None else self._previous
        # A missing reading (NaN) repeats a missing one. The first of all follows infinity: it is a change.
        joined = np.concatenate([previous, rows])
        changed = (joined[1:] != joined[:-1]) & ~(np.isnan(joined[1:]) & np.isnan(joined[:-1]))
        self._previous = joined[-1:]
        if changed.all():  # the usual case, and fast: it is that of each period of a servo loop
            self.longest, self._runs = np.maximum(self._runs, 1), np.ones_like(self._runs)
            return
        for i, columns in enumerate(self._groups):
            self._runs[i], self.longest[i] = _runs(changed[:, columns].any(axis=1), int(self._runs[i]))

    @property
    def suspect(self) -> bool:
        """True if a run that continues is so long that the force may differ from its reading."""
        return bool((self._runs > self._suspect).any())

    @property
    def fault(self) -> str | None:
        """The reason why the latest readings are not credible; None if they are."""
        stuck = np.flatnonzero(self.longest > self._stuck)
        if not len(stuck):
            return None
        group, usual = int(stuck[0]), self._usual
        duration, at_standstill = _MS * self.longest[group] / usual.rate, _MS * usual.longest[group] / usual.rate
        return (
            f"{usual.names[group]} repeats its reading in every digit for {duration:.0f} ms (at standstill for "
            f"{at_standstill:.0f} ms at most): the sensor is stuck or clipped, and the force is unknown"
        )


def _runs(changed: NDArray[np.bool_], begun: int) -> tuple[int, int]:
    """Return the run that continues at the end, and the longest; `changed` (n,): True where a reading differs.

    The first run continues one of `begun` readings.
    """
    edges = np.concatenate([[-begun], np.flatnonzero(changed), [len(changed)]])
    runs = np.diff(edges)
    return int(runs[-1]), int(runs.max())


def _exceeds_resolution(values: Floats) -> bool:
    """Return True if the noise of readings (n,) is larger than the smallest step between two of them."""
    finite = values[np.isfinite(values)]
    steps = np.diff(np.unique(finite))
    return len(steps) > 0 and float(finite.std()) >= float(steps.min())
