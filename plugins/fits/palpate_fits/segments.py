"""The samples that a fit uses: ``segment = "load, depth 0 mm..2 mm"``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, Samples, is_number, to_si
from palpate_kit.numerics.holds import hold_rows
from palpate_kit.numerics.refusal import NotFitted

Rows = NDArray[np.bool_]

WORDS = ("active", "all", "contact", "load", "unload", "hold", "cycle")
_ALLOWED = (
    '"active", "all", "contact", "load", "unload", "hold", "cycle", "0.5 s..2 s", "depth 0 mm..2 mm", "cycles 1..3", '
    "or several of them joined by commas"
)
_MOVING_SHARE = 0.1  # of the fastest rate in contact, below which the tip rests (choice)
_MIN_TRAVEL = 1e-12  # [m] in contact, in place of 0: below any resolution
_KINDS = ("depth", "cycles")


@dataclass(frozen=True)
class Window:
    """One condition on samples."""

    what: str  # one of WORDS, "time", "depth", "cycles"
    low: float = 0.0
    high: float = 0.0


def parse_segment(text: str) -> tuple[Window, ...]:
    """Return the windows of a text such as "load, depth 0 mm..2 mm"; raises ConfigurationError."""
    return tuple(_parse_window(part.strip(), text) for part in text.split(","))


def _parse_window(part: str, text: str) -> Window:
    """Return the window of one `part` of a text, a word or two ends such as "0.5 s..2 s" or "depth 0 mm..2 mm".

    Ends without a quantity are times; those of cycles are whole numbers, which may be the same. Raises
    ConfigurationError.
    """
    if part in WORDS:
        return Window(part)
    quantity = next((name for name in _KINDS if part.startswith(name)), "time")
    begin, dots, end = (text_part.strip() for text_part in part.removeprefix(quantity).partition(".."))
    if not (begin and dots and end):
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {part!r} is not one of {_ALLOWED}")
    try:
        low, high = _window_end(begin, quantity), _window_end(end, quantity)
    except ValueError as error:
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {error}") from error
    is_one_cycle = quantity == "cycles" and low == high
    if low >= high and not is_one_cycle:
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {part!r} is empty, it ends before it begins")
    return Window(quantity, low, high)


def _window_end(text: str, quantity: str) -> float:
    """Return an end of a window, a cycle, a depth [m] or a time [s]; raises ValueError for another text."""
    if quantity == "cycles":
        return float(int(text))
    return to_si(float(text) if is_number(text) else text, "m" if quantity == "depth" else "s")


@dataclass(frozen=True)
class RecordCourse:
    """Touch, deepest point and cycles of a record."""

    touch: float  # [m] height of the tip at the first sample in contact
    deepest: float  # [m] lowest height in contact
    cycle: NDArray[np.int32]  # (n,) from 1; 0 before the first

    @property
    def travel(self) -> float:
        """The depth [m] between first touch and the deepest point."""
        return self.touch - self.deepest

    @property
    def cycles(self) -> int:
        """The number of cycles."""
        return int(self.cycle.max(initial=0))


def passage(samples: Samples) -> RecordCourse:
    """Return the course of a record; raises NotFitted where the tip never touches or the force is not a signal."""
    has_force = np.isfinite(samples.force)
    _refuse_without_signal(samples.force[has_force], samples.time)
    touching = samples.contact & has_force
    if not touching.any():
        raise NotFitted("no-contact", "the tip never touches the material in this record")
    # A new cycle begins halfway in the air between two touches, so that each has its approach.
    starts = np.flatnonzero(touching & ~np.concatenate([[False], touching[:-1]]))
    ends = np.flatnonzero(touching & ~np.concatenate([touching[1:], [False]]))
    middles = (ends[:-1] + starts[1:] + 1) // 2
    begins = np.zeros(len(samples), np.int32)
    begins[0] = 1
    begins[middles] += 1
    touch = float(samples.position[starts[0]])
    deepest = float(samples.position[touching].min())
    return RecordCourse(touch, deepest, np.cumsum(begins, dtype=np.int32))


def _refuse_without_signal(force: Floats, time: Floats) -> None:
    """Raise NotFitted where no force (n,) [N] was read, it never changes, or the time [s] does not advance."""
    if not len(force):
        raise NotFitted("no-force", "the record has no force")
    if not np.any(force):
        raise NotFitted("no-force", "the force is zero throughout: a sensor that is not connected or never tared")
    if np.ptp(force) == 0:
        raise NotFitted("no-force", f"the force never changes: it reads {force[0]:.5g} N throughout")
    if np.any(np.diff(time) <= 0):
        raise NotFitted("no-time", "the time does not advance from every sample to the next")


def segment_rows(windows: tuple[Window, ...], samples: Samples, rate: Floats, course: RecordCourse) -> Rows:
    """Return the samples (n,) that every window allows and whose force is known; raises NotFitted if none is left.

    `rate` (n,) [m/s] is that of the depth.
    """
    rows = np.isfinite(samples.force) & np.isfinite(samples.position)
    for window in windows:
        allowed = _window_rows(window, samples, rate, course)
        if not (rows & allowed).any():
            raise NotFitted("segment-empty", _why_empty(window, samples, course))
        rows &= allowed
    return rows


def _window_rows(window: Window, samples: Samples, rate: Floats, course: RecordCourse) -> Rows:
    """Return True (n,) for the samples of one window.

    `rate` (n,) [m/s] is that of the depth; `course` has the height of the first touch, and the cycle of each sample.
    """
    depth = course.touch - samples.position
    # As much air as there is depth: enough for surface and baseline, without minutes of waiting.
    near = depth >= -max(course.travel, _MIN_TRAVEL)
    moving_rate = _MOVING_SHARE * float(np.nanmax(np.abs(rate[samples.contact]), initial=0.0))
    match window.what:
        case "active":
            return samples.active
        case "contact":
            return samples.contact
        case "load":
            return near & (rate > moving_rate)
        case "unload":
            return near & (rate < -moving_rate)
        case "hold":
            return hold_rows(samples)
        case "cycle":
            return near
        case "time":
            return (samples.time >= window.low) & (samples.time <= window.high)
        case "depth":
            return (depth >= window.low) & (depth <= window.high)
        case "cycles":
            return (course.cycle >= window.low) & (course.cycle <= window.high)
    return np.ones(len(samples), bool)


def _why_empty(window: Window, samples: Samples, course: RecordCourse) -> str:
    if window.what == "depth":
        reach = course.touch - float(np.nanmin(samples.position))
        return (
            f"depth {1e3 * window.low:g}..{1e3 * window.high:g} mm is never reached: the tip goes {1e3 * reach:.3g} mm "
            "below first touch"
        )
    if window.what == "time":
        return f"{window.low:g}..{window.high:g} s holds no sample: the record lasts {samples.time[-1]:.4g} s"
    if window.what == "cycles":
        return f"cycles {window.low:g}..{window.high:g}: the record has {course.cycles}"
    return f"no sample with a force is in the segment {window.what!r}"
