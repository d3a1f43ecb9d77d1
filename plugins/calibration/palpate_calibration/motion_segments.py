"""The stretches of a record in which the tip stands still or is shaken, from the motion itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_engine import Hesitations

from palpate_calibration.calibration_record import CalibrationRecord

# Choices. The swing is the standard deviation of the position over a window.
_WINDOW = 0.1  # [s] over which the motion is judged
_SHAKE_WINDOW = 1.0  # [s] over which a shake has to be even
_STANDSTILL_SWING = 2e-6  # [m] that is not motion
_MIN_MOTION_SWING = 2e-4  # [m]: no position at standstill is as noisy as that
_QUIET_QUANTILE = 0.02  # of all swings, which is that of the noise if the tip stands still at all
_QUIET_RATIO = 3.0  # to the swing of the noise, up to which the tip stands still
_QUIET_SHARE = 0.1  # of the largest swing, above which the tip moves
_SHAKE_SHARE = 0.2  # of the largest swing, below which a stretch does not count as a shake
_SHAKE_RATIO = 5.0  # to the swing at standstill, likewise
_EVEN_CHANGE = 0.1  # of the swing over a second, up to which a shake is even
_MIN_STANDSTILL = 0.4  # [s]
_MIN_SHAKE = 2.0  # [s], and half of it without its beginning
_MAX_HESITATING_SHARE = 0.5  # of a motion, up to which hesitations are left out
_EDGE = 0.1  # [s] left out at both ends of every stretch: streams are not yet aligned
_INSTANTS = 10_001  # of a segment, at which hesitations are counted


@dataclass(frozen=True)
class Segment:
    """A stretch of a record, by its time-stamps [s]."""

    begin: float
    end: float

    @property
    def length(self) -> float:
        """Duration [s]."""
        return self.end - self.begin


@dataclass(frozen=True)
class SteadyMotion:
    """The part of a segment in which the arm moves as planned, and does not hesitate."""

    hesitations: Hesitations
    count: int
    share: float  # of the segment that they take

    @classmethod
    def of(cls, record: CalibrationRecord, segment: Segment) -> SteadyMotion:
        """Return that of one segment of a record."""
        times = np.linspace(segment.begin, segment.end, _INSTANTS)
        share = float(np.mean(record.hesitations.hold(times)))
        return cls(record.hesitations, record.hesitations.count(segment.begin, segment.end), share)

    @property
    def breaks_up(self) -> bool:
        """True if hesitations are over half of it: too much to be left out."""
        return self.share > _MAX_HESITATING_SHARE

    def hold(self, time: Floats) -> NDArray[np.bool_]:
        """Return True (n,) at the times [s] that count: those without a hesitation; all where it breaks up."""
        return np.ones(len(time), bool) if self.breaks_up else ~self.hesitations.hold(time)


def hesitation_note(count: int) -> str:
    """Return in words how often the arm hesitated."""
    times = "once" if count == 1 else f"{count} times"
    return f"the arm hesitated {times} (a busy computer holds it up)"


def standstill_segments(record: CalibrationRecord) -> list[Segment]:
    """Return the stretches in which the position does not change by more than its noise, in order."""
    edges, swing = _swing(record)
    noise = float(np.quantile(swing, _QUIET_QUANTILE))
    is_quiet = swing < min(max(_QUIET_RATIO * noise, _STANDSTILL_SWING), _QUIET_SHARE * float(swing.max()))
    return _stretches(edges, is_quiet, record, _MIN_STANDSTILL)


def longest_standstill(record: CalibrationRecord) -> Segment | None:
    """Return the longest stretch of a record in which the tip stands still; None if it always moves."""
    edges, swing = _swing(record)
    noise = float(np.quantile(swing, _QUIET_QUANTILE))
    if noise > _MIN_MOTION_SWING:
        return None
    is_quiet = swing < max(_QUIET_RATIO * noise, _STANDSTILL_SWING)
    return max(_stretches(edges, is_quiet, record, _MIN_STANDSTILL), key=lambda segment: segment.length, default=None)


def shake_segments(record: CalibrationRecord, settle: float) -> list[Segment]:
    """Return the stretches of even to-and-fro motion, in order, without the first `settle` seconds of each.

    The swing over a window of a second must be the same half a second before and after: a shake fades in and out.
    """
    edges, swing = _swing(record)  # ends [s] of short windows, and the position's deviation in each
    width = round(_SHAKE_WINDOW / _WINDOW)
    if len(swing) < 2 * width:
        return []

    # The swing over a second, compared with that half a second before and after.
    second_swing = np.sqrt(np.convolve(swing**2, np.ones(width) / width, "same"))
    half = width // 2
    padded = np.pad(second_swing, half)
    is_even = np.abs(padded[2 * half :] - padded[: -2 * half]) < _EVEN_CHANGE * second_swing
    min_swing = max(_SHAKE_SHARE * float(second_swing.max()), _SHAKE_RATIO * _STANDSTILL_SWING)
    stretches = _stretches(edges, is_even & (second_swing > min_swing), record, _MIN_SHAKE)

    # Without its beginning, in which the arm settles.
    settled = [Segment(s.begin + settle, s.end) for s in stretches if _comes_back(record, s)]
    return [segment for segment in settled if segment.length >= _MIN_SHAKE / 2]


def _comes_back(record: CalibrationRecord, segment: Segment) -> bool:
    """Return True if a stretch goes to and fro, not from one place to another."""
    _, values = record.position.between(segment.begin, segment.end)
    quarter = max(len(values) // 4, 1)
    return abs(float(values[-quarter:].mean() - values[:quarter].mean())) < float(values.std())


def _swing(record: CalibrationRecord) -> tuple[Floats, Floats]:
    """Return edges of windows (k + 1,) [s], and the standard deviation (k,) of the position in each."""
    count = max(int((record.end - record.begin) / _WINDOW), 1)
    edges = np.asarray(record.begin + _WINDOW * np.arange(count + 1), np.float64)
    rows = np.searchsorted(record.position.time, edges)
    values = record.position.values
    swing = [float(values[a:b].std()) if b - a > 1 else np.inf for a, b in pairwise(rows)]
    return edges, np.array(swing, np.float64)


def _stretches(
    edges: Floats, in_stretch: NDArray[np.bool_], record: CalibrationRecord, min_length: float
) -> list[Segment]:
    """Return the stretches of neighbouring windows (k,) that are True, without their ends, of a least length [s]."""
    padded = np.concatenate([[False], in_stretch, [False]])
    begins = np.flatnonzero(~padded[:-1] & padded[1:])
    ends = np.flatnonzero(padded[:-1] & ~padded[1:])
    segments = [
        Segment(float(edges[a]) + _EDGE, min(float(edges[b]), record.end) - _EDGE)
        for a, b in zip(begins, ends, strict=True)
    ]
    return [segment for segment in segments if segment.length >= min_length]
