"""Which samples a fit uses: ``segment = "load, depth 0 mm..2 mm"``."""

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
_MOVING = 0.1  # of the fastest rate; slower is rest
_KINDS = ("depth", "cycles")


@dataclass(frozen=True)
class Window:
    """One condition on samples."""

    what: str  # one of WORDS, "time", "depth", "cycles"
    low: float = 0.0
    high: float = 0.0


def parse_segment(text: str) -> tuple[Window, ...]:
    """Return the windows of a text such as "load, depth 0 mm..2 mm"; raises ConfigurationError."""
    return tuple(_parse_one(part.strip(), text) for part in text.split(","))


def _parse_one(part: str, text: str) -> Window:
    if part in WORDS:
        return Window(part)
    what = next((kind for kind in _KINDS if part.startswith(kind)), "time")
    begin, dots, end = (words.strip() for words in part.removeprefix(what).partition(".."))
    if not (begin and dots and end):
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {part!r} is not one of {_ALLOWED}")
    try:
        if what == "cycles":
            low, high = float(int(begin)), float(int(end))
        else:
            unit = "m" if what == "depth" else "s"
            low, high = (to_si(float(m) if is_number(m) else m, unit) for m in (begin, end))
    except ValueError as error:
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {error}") from error
    if low >= high and not (what == "cycles" and low == high):
        raise ConfigurationError(f"estimator casadi-fit: segment {text!r}: {part!r} is empty, it ends before it begins")
    return Window(what, low, high)


@dataclass(frozen=True)
class RecordCourse:
    """What a fit knows of the course of a record before it fits."""

    touch: float  # [m] height of the tip at the first sample in contact
    deepest: float  # [m] lowest height in contact
    cycle: NDArray[np.int32]  # (n,) from 1; 0 before the first

    @property
    def travel(self) -> float:
        """Depth [m] between first touch and the deepest point."""
        return self.touch - self.deepest

    @property
    def cycles(self) -> int:
        """How often the tip touched."""
        return int(self.cycle.max(initial=0))


def passage(samples: Samples) -> RecordCourse:
    """Return the course of a record; raises NotFitted where the tip never touches or the force is not a signal."""
    known = np.isfinite(samples.force)
    if not known.any():
        raise NotFitted("no-force", "the record has no force")
    if not np.any(samples.force[known]):
        raise NotFitted("no-force", "the force is zero throughout: a sensor that is not connected or never tared")
    if np.ptp(samples.force[known]) == 0:
        raise NotFitted("no-force", f"the force never changes: it reads {samples.force[known][0]:.5g} N throughout")
    if np.any(np.diff(samples.time) <= 0):
        raise NotFitted("no-time", "the time does not advance from every sample to the next")
    touching = samples.contact & known
    if not touching.any():
        raise NotFitted("no-contact", "the tip never touches the material in this record")
    first = int(np.argmax(touching))
    begins = touching & ~np.concatenate([[False], touching[:-1]])
    # A new cycle begins halfway in the air between two touches, so that each has its approach.
    cycle = np.zeros(len(samples), np.int32)
    starts = np.flatnonzero(begins)
    ends = np.flatnonzero(touching & ~np.concatenate([touching[1:], [False]]))
    middle = (ends[:-1] + starts[1:] + 1) // 2
    cycle[0] = 1
    cycle[middle] += 1
    return RecordCourse(
        float(samples.position[first]), float(samples.position[touching].min()), np.cumsum(cycle, dtype=np.int32)
    )


def segment_rows(windows: tuple[Window, ...], samples: Samples, rate: Floats, course: RecordCourse) -> Rows:
    """(n,) the samples that every window allows and whose force is known; raises NotFitted if none is left."""
    rows = np.isfinite(samples.force) & np.isfinite(samples.position)
    for window in windows:
        allowed = _allowed(window, samples, rate, course)
        if not (rows & allowed).any():
            raise NotFitted("segment-empty", _why_empty(window, samples, course))
        rows &= allowed
    return rows


def _allowed(window: Window, samples: Samples, rate: Floats, course: RecordCourse) -> Rows:
    depth = course.touch - samples.position
    # As much air as there is depth: enough for surface and baseline, without minutes of waiting.
    near = depth >= -max(course.travel, 1e-12)
    moving = _MOVING * float(np.nanmax(np.abs(rate[samples.contact]), initial=0.0))
    match window.what:
        case "active":
            return samples.active
        case "contact":
            return samples.contact
        case "load":
            return near & (rate > moving)
        case "unload":
            return near & (rate < -moving)
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
