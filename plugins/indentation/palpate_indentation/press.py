"""One way into a material and out again, cut out of a record: heights, forces, and how noisy the force is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, Samples
from palpate_engine import change_point
from palpate_kit.numerics.tip_travel import zero_phase_motion

_REVERSAL = 0.05  # of the travel, a choice: a shorter way back is noise of the height
_MIN_SAMPLES = 40  # on the way in, a choice: ten for each of modulus, surface, offset and tilt
_MIN_AIR_SAMPLES = 10  # a choice: a line through fewer is mostly noise
_AIR_MARGIN = 0.02  # of the travel, a choice: so near to the change point, which is not exact, nothing counts as air
_LEVEL_SHARE = 0.25  # of the travel, a choice: the part at the top that a first line of the air goes through
_DEVIATION_SIGMAS = 6.0  # of the noise, a choice: white noise passes it once in 5e8 readings
_DEVIATING_READINGS = 5  # in a row, a choice: outliers come singly
_DIFFERENCE_GAIN = 20.0  # variance of third differences of white noise of 1: 1 + 9 + 9 + 1
_SIGMA_OF_MEDIAN = 1.4826  # standard deviation over median magnitude of a normal distribution
_MIN_NOISE = 1e-300  # [N] guards against a division by 0
IN, OUT = 0.0, 1.0  # of a record's own segments; any other value is at rest, or before the press


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

    def select(self, rows: slice | NDArray[np.bool_]) -> Branch:
        """Return the readings of some rows."""
        return Branch(*(column[rows] for column in self._columns))

    def joined_with(self, other: Branch) -> Branch:
        """Return the readings of this branch, followed by those of another."""
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

    `segment` (n,) is the record's own statement of which readings are on the way in (`IN`) and out (`OUT`); with it the
    course of the height is not examined. The inertia of a `tip_mass` [kg] is subtracted from the force.
    """
    is_known = np.isfinite(samples.force) & np.isfinite(samples.position)
    if between is not None:
        is_known &= (samples.time >= between[0]) & (samples.time <= between[1])
    known_samples = samples[is_known]
    count = len(known_samples)
    if count < _MIN_SAMPLES or np.ptp(known_samples.position) == 0 or np.ptp(known_samples.force) == 0:
        raise LogError(f"{name}: holds no press: {count} samples, or a height or force that never changes")

    # The two directions of the motion; a way out that is too short is left out.
    whole = _branch(known_samples, tip_mass or 0.0)
    way_in, way_out = _ways(known_samples.position, None if segment is None else segment[is_known])
    approach = whole.select(way_in)
    if len(approach) < _MIN_SAMPLES:
        raise LogError(f"{name}: the way into the material has {len(approach)} samples, {_MIN_SAMPLES} are needed")
    retract = whole.select(way_out) if way_out.stop - way_out.start >= _MIN_SAMPLES else None

    # The air ends a margin, 2 % of the travel, above the first estimate of the surface.
    noise = _noise(approach.force)
    surface = _first_surface(approach, noise)
    if surface is None:
        raise LogError(f"{name}: the force never rises out of its noise on the way in")
    margin = _AIR_MARGIN * float(np.ptp(approach.height))
    air = int(np.count_nonzero(np.cumsum(approach.height < surface + margin) == 0))
    if air < _MIN_AIR_SAMPLES:
        raise LogError(f"{name}: {air} samples of air before contact; a baseline needs {_MIN_AIR_SAMPLES}")
    return Press(approach, retract, air, noise)


def _branch(samples: Samples, tip_mass: float) -> Branch:
    """Return the samples as one branch, with the inertia of a tip mass [kg] subtracted from the force."""
    interval = np.diff(samples.time, prepend=samples.time[0])
    motion = zero_phase_motion(replace(samples, interval=interval), None)
    force = samples.force - tip_mass * motion.acceleration
    return Branch(samples.time, samples.position, force, motion.rate, motion.acceleration)


def _ways(height: Floats, segment: Floats | None) -> tuple[slice, slice]:
    """Return the rows of the way in and of the way out: by the record's segments (n,), else by its heights (n,) [m].

    Segments that are all the same, or never `IN`, state nothing.
    """
    if segment is not None and np.any(segment == IN) and np.any(segment != IN):
        way_in = _segment_rows(segment, IN, int(np.argmax(segment == IN)))
        is_out = segment[way_in.stop :] == OUT
        out_start = way_in.stop + int(np.argmax(is_out)) if is_out.any() else len(segment)
        return way_in, _segment_rows(segment, OUT, out_start)
    top_row, deepest_row, last_row = _turning_rows(height)
    return slice(top_row, deepest_row + 1), slice(deepest_row, last_row + 1)


def _segment_rows(segment: Floats, value: float, start: int) -> slice:
    """Return the rows from `start` on for as long as the segment has a value."""
    other_rows = np.flatnonzero(segment[start:] != value)
    return slice(start, start + int(other_rows[0]) if len(other_rows) else len(segment))


def _turning_rows(height: Floats) -> tuple[int, int, int]:
    """Return the rows at which the first press begins, is deepest, and has its way out end, by heights (n,) [m].

    The way down ends where the tip, in the lower half of its travel, moves up again by more than 5 % of the travel; the
    way out ends where it moves down again by as much.
    """
    # The way down ends at the deepest reading before the first reversal.
    travel = float(np.ptp(height))
    lowest_before = np.minimum.accumulate(height)
    in_lower_half = height.max() - lowest_before > 0.5 * travel
    reversals = np.flatnonzero((height - lowest_before > _REVERSAL * travel) & in_lower_half)
    down_stop = int(reversals[0]) + 1 if len(reversals) else len(height)
    deepest_row = int(np.argmin(height[:down_stop]))
    top_row = int(np.argmax(height[: deepest_row + 1]))

    # The way out ends at the highest reading before the next way down.
    out_height = height[deepest_row:]
    next_descents = np.flatnonzero(np.maximum.accumulate(out_height) - out_height > _REVERSAL * travel)
    out_stop = int(next_descents[0]) + 1 if len(next_descents) else len(out_height)
    return top_row, deepest_row, deepest_row + int(np.argmax(out_height[:out_stop]))


def _first_surface(approach: Branch, noise: float) -> float | None:
    """Return the height [m] at which contact begins by a change point above the line of the air.

    Without a change point, that from which several readings in a row are off the line by far more than the
    noise [N]: up or, where the tip is drawn in, down. None where no readings are.
    """
    force = approach.force - _air_line(approach)(approach.height)
    change = change_point(approach.height, force)
    if change is not None:
        return change.surface
    # Five readings in a row, 6 sigma each.
    is_off = np.abs(force) > _DEVIATION_SIGMAS * noise
    run_lengths = np.convolve(is_off, np.ones(_DEVIATING_READINGS), mode="valid")
    rows = np.flatnonzero(run_lengths == _DEVIATING_READINGS)
    return float(approach.height[rows[0]]) if len(rows) else None


def _air_line(branch: Branch) -> np.poly1d:
    """Return the line of the force [N] over height [m] at the top, by which a tilted baseline leaves a change point."""
    is_top = branch.height > branch.height.max() - _LEVEL_SHARE * np.ptp(branch.height)
    enough = is_top.sum() > _MIN_AIR_SAMPLES
    coefficients = np.polyfit(branch.height[is_top], branch.force[is_top], 1) if enough else [0.0]
    return np.poly1d(coefficients)


def _noise(force: Floats) -> float:
    """Return the standard deviation [N] of one reading, by third differences, in which slow motion cancels."""
    differences = np.diff(force, 3)
    return max(float(_SIGMA_OF_MEDIAN * np.median(np.abs(differences)) / np.sqrt(_DIFFERENCE_GAIN)), _MIN_NOISE)
