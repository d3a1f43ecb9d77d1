"""Where in a record the tip stands still and where it is shaken, from the motion itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_engine import Hesitations

from palpate_calibration.calibration_record import CalibrationRecord

_WINDOW = 0.1  # [s] over which the motion is judged
_STILL = 2e-6  # [m]; a standard deviation of the position that is not motion
_MOVING = 2e-4  # [m]; no position at standstill is as noisy as that
_EVEN = 0.1  # change of the swing over a second that is still even
_SHORTEST_STANDSTILL = 0.4  # [s]
_SHORTEST_SHAKE = 2.0  # [s]
_MOST_LEFT_OUT = 0.5  # of a motion, for hesitations
_EDGE = 0.1  # [s] left out at both ends of every stretch: streams are not yet aligned


@dataclass(frozen=True)
class Segment:
    """A stretch of a record, by its time-stamps [s]."""

    begin: float
    end: float

    @property
    def length(self) -> float:
        """How long it is [s]."""
        return self.end - self.begin


@dataclass(frozen=True)
class SteadyMotion:
    """Where in a segment the arm moves as planned, and does not hesitate."""

    hesitations: Hesitations
    count: int
    share: float  # of the segment that they take

    @classmethod
    def of(cls, record: CalibrationRecord, segment: Segment) -> SteadyMotion:
        """That of one segment of a record."""
        times = np.linspace(segment.begin, segment.end, 10_001)
        share = float(np.mean(record.hesitations.hold(times)))
        return cls(record.hesitations, record.hesitations.count(segment.begin, segment.end), share)

    @property
    def breaks_up(self) -> bool:
        """True if hesitations are over half of it: too much to be left out."""
        return self.share > _MOST_LEFT_OUT

    def hold(self, time: Floats) -> NDArray[np.bool_]:
        """(n,) True at the times [s] that count: those without a hesitation; all where it breaks up."""
        return np.ones(len(time), bool) if self.breaks_up else ~self.hesitations.hold(time)


def hesitation_note(count: int) -> str:
    """That the arm hesitated, in words."""
    often = "once" if count == 1 else f"{count} times"
    return f"the arm hesitated {often} (a busy computer holds it up)"


def standing_still(record: CalibrationRecord) -> list[Segment]:
    """Return the stretches in which the position does not change by more than its noise, in order."""
    edges, swing = _swing(record)
    quiet = swing < min(max(3.0 * float(np.quantile(swing, 0.02)), _STILL), 0.1 * float(swing.max()))
    return _stretches(edges, quiet, record, _SHORTEST_STANDSTILL)


def longest_standstill(record: CalibrationRecord) -> Segment | None:
    """Return the longest stretch of a record in which the tip stands still; None if it always moves."""
    edges, swing = _swing(record)
    noise = float(np.quantile(swing, 0.02))
    if noise > _MOVING:
        return None
    found = _stretches(edges, swing < max(3.0 * noise, _STILL), record, _SHORTEST_STANDSTILL)
    return max(found, key=lambda segment: segment.length, default=None)


def shake_segments(record: CalibrationRecord, settle: float) -> list[Segment]:
    """Return the stretches of even to-and-fro motion, in order, without the first `settle` seconds of each.

    The swing over a window of a second must be the same half a second before and after: a shake fades in and out.
    """
    edges, swing = _swing(record)
    width = round(1.0 / _WINDOW)
    if len(swing) < 2 * width:
        return []
    longer = np.sqrt(np.convolve(swing**2, np.ones(width) / width, "same"))
    half = width // 2
    padded = np.pad(longer, half)
    even = np.abs(padded[2 * half :] - padded[: -2 * half]) < _EVEN * longer
    busy = even & (longer > max(0.2 * float(longer.max()), 5.0 * _STILL))
    found = _stretches(edges, busy, record, _SHORTEST_SHAKE)
    cut = [Segment(s.begin + settle, s.end) for s in found if _comes_back(record, s)]
    return [segment for segment in cut if segment.length >= _SHORTEST_SHAKE / 2]


def _comes_back(record: CalibrationRecord, segment: Segment) -> bool:
    """Return True if a stretch goes to and fro, not from one place to another."""
    _, values = record.position.between(segment.begin, segment.end)
    quarter = max(len(values) // 4, 1)
    return abs(float(values[-quarter:].mean() - values[:quarter].mean())) < float(values.std())


def _swing(record: CalibrationRecord) -> tuple[Floats, Floats]:
    """Edges of windows (k + 1,) [s] and the standard deviation (k,) of the position in each."""
    count = max(int((record.end - record.begin) / _WINDOW), 1)
    edges = np.asarray(record.begin + _WINDOW * np.arange(count + 1), np.float64)
    rows = np.searchsorted(record.position.time, edges)
    values = record.position.values
    swing = [float(values[a:b].std()) if b - a > 1 else np.inf for a, b in pairwise(rows)]
    return edges, np.array(swing, np.float64)


def _stretches(edges: Floats, wanted: NDArray[np.bool_], record: CalibrationRecord, shortest: float) -> list[Segment]:
    padded = np.concatenate([[False], wanted, [False]])
    begins = np.flatnonzero(~padded[:-1] & padded[1:])
    ends = np.flatnonzero(padded[:-1] & ~padded[1:])
    found = [
        Segment(float(edges[a]) + _EDGE, min(float(edges[b]), record.end) - _EDGE)
        for a, b in zip(begins, ends, strict=True)
    ]
    return [segment for segment in found if segment.length >= shortest]
