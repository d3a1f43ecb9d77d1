"""One way into a material and out again, cut out of a record: heights, forces, and how noisy the force is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, Samples
from palpate_engine import change_point
from palpate_kit.numerics.tip_travel import zero_phase_motion

_TURN = 0.05  # of the way down; less of a way back is noise
_LEAST = 40  # samples on the way in
_LEAST_AIR = 10  # samples
_AIR_MARGIN = 0.02  # of the way before the change point that is left out of the air
_OFF = 6.0  # noise standard deviations
_IN_ALL = 5  # readings in a row
IN, OUT = 0.0, 1.0  # of a record's own segments; what is neither is at rest, or before the press


@dataclass(frozen=True)
class Branch:
    """One direction of the motion; heights [m] out of the material, forces [N], (n,)."""

    time: Floats
    height: Floats
    force: Floats  # of the contact: without the tip's inertia where its mass is known
    rate: Floats  # (n,) [m/s] of the depth
    acceleration: Floats  # (n,) [m/s^2] of the depth

    def __len__(self) -> int:
        return len(self.time)

    def part(self, rows: slice | NDArray[np.bool_]) -> Branch:
        """Some of its readings."""
        return Branch(*(column[rows] for column in self._columns))

    def joined(self, other: Branch) -> Branch:
        """Its readings, then those of another."""
        return Branch(*map(np.concatenate, zip(self._columns, other._columns, strict=True)))

    @property
    def _columns(self) -> tuple[Floats, ...]:
        return self.time, self.height, self.force, self.rate, self.acceleration


@dataclass(frozen=True)
class Press:
    """The way in with its air, and the way out where it was recorded."""

    approach: Branch
    retract: Branch | None
    air: int  # samples of the approach before contact, beyond doubt
    touch: float  # [m] where a change point sees contact begin
    noise: float  # [N] standard deviation of one reading


def press_of(
    samples: Samples,
    between: tuple[float, float] | None = None,
    name: str = "record",
    *,
    segment: Floats | None = None,
    tip_mass: float | None = None,
) -> Press:
    """Return the first press of a record, or of a stretch of it [s]; raises LogError if it has none.

    A record that says by a `segment` (n,) which of its readings are on the way in is taken at its word.
    """
    known = np.isfinite(samples.force) & np.isfinite(samples.position)
    if between is not None:
        known &= (samples.time >= between[0]) & (samples.time <= between[1])
    kept = samples[known]
    if len(kept) < _LEAST or np.ptp(kept.position) == 0 or np.ptp(kept.force) == 0:
        raise LogError(f"{name}: holds no press: {len(kept)} samples, or a height or force that never changes")
    whole = _branch(kept, tip_mass or 0.0)
    way_in, way_out = _ways(kept.position, None if segment is None else segment[known])
    approach = whole.part(way_in)
    if len(approach) < _LEAST:
        raise LogError(f"{name}: the way into the material has {len(approach)} samples, {_LEAST} are needed")
    retract = whole.part(way_out) if way_out.stop - way_out.start >= _LEAST else None
    level = _level(approach)
    found = change_point(approach.height, approach.force - level(approach.height))
    noise = _noise(approach.force)
    touch = found.surface if found is not None else _first_off(approach, level(approach.height), noise)
    if touch is None:
        raise LogError(f"{name}: the force never rises out of its noise on the way in")
    margin = _AIR_MARGIN * float(np.ptp(approach.height))
    air = int(np.count_nonzero(np.cumsum(approach.height < touch + margin) == 0))
    if air < _LEAST_AIR:
        raise LogError(f"{name}: {air} samples of air before contact; a baseline needs {_LEAST_AIR}")
    return Press(approach, retract, air, touch, noise)


def _ways(height: Floats, segment: Floats | None) -> tuple[slice, slice]:
    """Rows of the way in and of the way out: as the record says, else by the course of the height.

    A record all of whose readings are in one segment says nothing.
    """
    if segment is not None and np.any(segment == IN) and np.any(segment != IN):
        first = _run(segment, IN, int(np.argmax(segment == IN)))
        after = segment[first.stop :] == OUT
        begin = first.stop + int(np.argmax(after)) if after.any() else len(segment)
        return first, _run(segment, OUT, begin)
    begin, turn, end = _turns(height)
    return slice(begin, turn + 1), slice(turn, end + 1)


def _run(segment: Floats, value: float, begin: int) -> slice:
    """Rows from one on as long as the segment has a value."""
    others = np.flatnonzero(segment[begin:] != value)
    return slice(begin, begin + int(others[0]) if len(others) else len(segment))


def _first_off(branch: Branch, level: Floats, noise: float) -> float | None:
    """Height [m] from which on several readings in a row are off the level, up or, where the tip is drawn in, down."""
    off = np.abs(branch.force - level) > _OFF * noise
    rows = np.flatnonzero(np.convolve(off, np.ones(_IN_ALL), mode="valid") == _IN_ALL)
    return float(branch.height[rows[0]]) if len(rows) else None


def _turns(height: Floats) -> tuple[int, int, int]:
    """Begin of the way down, its deepest sample, and the end of the way out that follows."""
    reach = float(np.ptp(height))
    lowest = np.minimum.accumulate(height)
    up = np.flatnonzero((height - lowest > _TURN * reach) & (height.max() - lowest > 0.5 * reach))
    until = int(up[0]) + 1 if len(up) else len(height)
    turn = int(np.argmin(height[:until]))
    begin = int(np.argmax(height[: turn + 1]))
    out = height[turn:]
    down = np.flatnonzero(np.maximum.accumulate(out) - out > _TURN * reach)
    last = int(down[0]) + 1 if len(down) else len(out)
    return begin, turn, turn + int(np.argmax(out[:last]))


def _branch(samples: Samples, tip_mass: float) -> Branch:
    interval = np.diff(samples.time, prepend=samples.time[0])
    motion = zero_phase_motion(replace(samples, interval=interval), None)
    force = samples.force - tip_mass * motion.acceleration
    return Branch(samples.time, samples.position, force, motion.rate, motion.acceleration)


def _level(branch: Branch) -> np.poly1d:
    """Line through the first quarter of the way, which a tilted baseline makes the change point begin from."""
    top = branch.height > branch.height.max() - 0.25 * np.ptp(branch.height)
    found = np.polyfit(branch.height[top], branch.force[top], 1) if top.sum() > _LEAST_AIR else [0.0]
    return np.poly1d(found)


def _noise(values: Floats) -> float:
    """From third differences, in which slow motion drops out (white noise gives them 20 times its variance)."""
    third = np.diff(values, 3)
    return max(float(1.4826 * np.median(np.abs(third)) / np.sqrt(20.0)), 1e-300)
