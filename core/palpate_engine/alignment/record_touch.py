"""The first touch in a record whose own noise says what counts as touch: what inertia, drift and travel cannot be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.air_line import FEWEST_IN_AIR, FIRST_READINGS, ROBOT_FORCE
from palpate_engine.alignment.aliased_hum import left_by_hum
from palpate_engine.alignment.change_point import samples_as_one, shortest_descent, white_noise
from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, run_lengths

_EVERY, _OFTEN = 16, 32  # samples between two looks: so many, or such a part of what there is
_DRIFT = 0.05  # [N/s] of a sensor that warms up (choice); a press of 1 N takes less than 20 s
_CABLE = 2.0  # [N/m] of a cable that the tip pulls along
_ROWS = 1024  # means of the record that are looked at together, at most
_PULSE = 0.05  # [s] over which accelerations are taken
_ABOVE = 4.0  # standard deviations of a derived acceleration, below which it is noise
_GRID, _LEVELS = 33, 3  # heights that are tried together, and how often the grid narrows
_GAIN = 100.0  # of the sum of squares in units of the noise's variance: ten sigma, jointly
_OVER_WAVE = 16.0  # the same, in addition to the best wave of hum or of a line that bends
_BENDS = 2.0  # waves over the readings, of an optical lever's baseline (1 in 3 um of travel is usual)
_STEPS = 3.0  # of the resolution, that what only contact explains rises by at least
_SPREAD, _BELIEVED = 2.0, 0.2  # what the law may leave: standard deviations of the noise, share of the rise
_BELIEVED_WITHOUT_AIR = 0.03  # the same of a record that begins in contact: a cone leaves so much, a wave more
_PARTS = (8, 32)
_ALIKE = 1e-6  # share of a term that the others leave, below which it counts as zero
_REPEATS = 4096  # readings whose resolution is looked at


@dataclass(frozen=True)
class RecordTouch:
    """Where contact begins in a stretch that shows it."""

    begin: int  # index of the first sample below the surface
    surface: float  # [m]
    step: float  # [N] resolution of the force; 0: none shows
    noise: float  # [N] of one reading, by the third differences of all of them


class TouchSearch:
    """Looks for the first touch at set numbers of samples from the record's begin, however they arrive."""

    def __init__(self, most_mass: float) -> None:
        self._most_mass = most_mass
        self._looked, self._seen = 0, False  # samples of the last look, and whether it showed contact
        self.due = FIRST_READINGS  # samples at which the next look is taken

    def found(self, samples: Samples, final: bool) -> RecordTouch | None:
        """Return the touch, by all samples of the record so far; where `final`, a look at the end is the last."""
        while self.due <= len(samples) or (final and self._looked < len(samples)):
            self._looked = min(self.due, len(samples))
            touch = record_touch(samples[: self._looked], self._most_mass)
            self.due += max(_EVERY, self.due // _OFTEN)
            if touch is not None and self._seen:
                return touch
            self._seen = touch is not None
        return None

    def of_record(self, samples: Samples) -> RecordTouch | None:
        """Return the touch by all samples of a record that has ended, where a law of contact from its begin explains
        them."""
        return record_touch(samples, self._most_mass, _BELIEVED_WITHOUT_AIR)

    def is_air(self, samples: Samples) -> bool:
        """Return True if a record without a touch has no more force than a cable and inertia may give, or hum
        explains it."""
        known = samples[np.isfinite(samples.force) & np.isfinite(samples.position)]
        bend = _accelerated(known.time, known.force, known.position)[3] if len(known) > FEWEST_IN_AIR else None
        is_still = float(np.ptp(known.force)) < _range_in_air(known.position, bend, self._most_mass)
        return is_still or _is_hum(known)


def record_touch(samples: Samples, most_mass: float, believed: float = _BELIEVED) -> RecordTouch | None:
    """Return the touch that samples from a record's begin show; None where air explains them as well.

    Air is F = b + s t + k z - m a + noise with m from 0 to `most_mass` [kg]: the sensor's zero and its drift, a cable
    or a tilt, the inertia of what hangs behind the sensor. Contact adds c (z_s - z)^1.5 below z_s. It is found where
    that lowers the sum of squares by the square of ten standard deviations of the noise in the air before, whatever m,
    and leaves no more than a `believed` share of the rise.
    """
    known = np.flatnonzero(np.isfinite(samples.force) & np.isfinite(samples.position))
    if len(known) < 2 * FEWEST_IN_AIR:
        return None
    height, reading = samples.position[known], samples.force[known]
    least = shortest_descent(height, float(np.ptp(height)))
    if not float(np.ptp(height)) > least or not float(np.ptp(reading)) > 0.0:
        return None
    size = -(-len(known) // _ROWS)
    time, force, place = (_means(column[known], size) for column in (samples.time, samples.force, samples.position))
    noise = white_noise(reading) / np.sqrt(size)
    step = resolution(reading)
    bend = None
    if most_mass > 0.0:
        time, force, place, bend = _accelerated(time, force, place)
    found = _surface(time, force, place, bend, most_mass)
    if found is None:
        return None
    surface, gain, rise, left, basis, rest = found
    below = place < surface
    first = int(np.argmax(below))
    if surface - float(place.min()) < least:
        return None
    # A tip that moves in contact from the start on changes the force by more than drift and travel through air do.
    if first:
        drift = _DRIFT * float(time[first - 1] - time[0])
        if float(np.ptp(force[:first])) >= _range_in_air(place[:first], bend, most_mass) + drift:
            return None
    air = left[:first]
    as_one = float(air @ air) / len(air) * _as_one(air) if len(air) else 0.0
    variance = max(noise**2, as_one, step**2 / 12.0 * _as_one(left))
    rms = float(np.sqrt(left[first:] @ left[first:] / len(left[first:])))
    if gain < _GAIN * variance or rise < _STEPS * step or rms > _SPREAD * np.sqrt(variance) + believed * rise:
        return None
    # Where a mass is set in motion, what it leaves would pass for noise, and any press for a bent line.
    bends = _BENDS if bend is None else 0.0
    if _gain_over_wave(time, basis, rest, left, _interval(samples[known]), bends) < _OVER_WAVE * variance:
        return None
    lasting = run_lengths(height < surface, 0) >= SAMPLES_IN_A_ROW
    if not lasting.any():
        return None
    begin = int(known[int(np.argmax(lasting)) - SAMPLES_IN_A_ROW + 1])
    return RecordTouch(begin, surface, step, max(white_noise(reading), step / np.sqrt(12.0)))


def _range_in_air(place: Floats, bend: Floats | None, most_mass: float) -> float:
    """Return the range of force [N] that a robot's own, a cable and inertia may give without drift."""
    inertia = 0.0 if bend is None else most_mass * float(np.ptp(bend))
    return ROBOT_FORCE + _CABLE * float(np.ptp(place)) + inertia


def _gain_over_wave(time: Floats, basis: Floats, rest: Floats, left: Floats, interval: float, bends: float) -> float:
    """By how much contact lowers the sum of squares in addition to a wave, of hum or of a line of air that bends.

    Infinite where neither is possible.
    """
    air = left_by_hum(time, basis, rest, interval, bends)
    if not np.isfinite(air):
        return air
    law = rest - left
    return air - left_by_hum(time, np.column_stack([basis, law / np.linalg.norm(law)]), left, interval, bends)


def _is_hum(samples: Samples) -> bool:
    """Return True if drift, travel and a wave that hum may be leave of the force no more than its noise."""
    if len(samples) < 2 * FEWEST_IN_AIR:
        return False
    size = -(-len(samples) // _ROWS)
    time, force, place = (_means(column, size) for column in (samples.time, samples.force, samples.position))
    basis = _basis([np.ones(len(time)), time - time.mean(), place - place.mean()])
    left = left_by_hum(time, basis, force - basis @ (basis.T @ force), _interval(samples))
    return left < len(time) * (_SPREAD * white_noise(samples.force)) ** 2 / size


def _interval(samples: Samples) -> float:
    return float(samples.time[-1] - samples.time[0]) / (len(samples) - 1)


def resolution(values: Floats) -> float:
    """Step of values (n,) that repeat, as those that an instrument rounds; 0 where they do not."""
    some = values[-_REPEATS:]
    unique = np.unique(some)
    if len(unique) < 2 or len(unique) > 0.5 * len(some):
        return 0.0
    return float(np.median(np.diff(unique)))


def _means(values: Floats, size: int) -> Floats:
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))


def _accelerated(time: Floats, force: Floats, place: Floats) -> tuple[Floats, Floats, Floats, Floats | None]:
    """The same averaged by a triangle, and the acceleration (n,): the second difference of the height is that average.

    So that force and acceleration are of one instant, however short a pulse. None where no acceleration is above what
    the noise of the height makes of it.
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    reach = min(max(round(_PULSE / interval), 1), len(time) // 20) if interval > 0 else 0
    if reach < 1:
        return time, force, place, None
    weights = np.convolve(np.ones(reach), np.ones(reach)) / reach**2
    acceleration = (place[2 * reach :] - 2.0 * place[reach:-reach] + place[: -2 * reach]) / (reach * interval) ** 2
    noise = np.sqrt(6.0) * white_noise(place) / (reach * interval) ** 2
    acceleration = np.where(np.abs(acceleration) > _ABOVE * noise, acceleration, 0.0)
    force, place = (np.convolve(column, weights, "valid")[1:-1] for column in (force, place))
    return time[reach:-reach], force, place, acceleration if acceleration.any() else None


def _surface(
    time: Floats, force: Floats, place: Floats, bend: Floats | None, most_mass: float
) -> tuple[float, float, float, Floats, Floats, Floats] | None:
    """Surface [m], by how much contact lowers the sum of squares, what only it explains, and what is left (n,) [N].

    Then orthonormal terms of air (n, k), and what these leave (n,) [N].
    """
    terms = [np.ones(len(time)), time - time.mean(), place - place.mean()]
    if bend is not None:
        mass = _fitted([*terms, -bend], force)[-1]
        if 0.0 < mass <= most_mass:
            terms.append(-bend)
        elif mass > most_mass:
            force = force + most_mass * bend
    basis = _basis(terms)
    rest = force - basis @ (basis.T @ force)
    low, high = float(place.min()), float(place.max())
    best = (0.0, 0.0, 0.0)  # gain, surface, slope
    for _ in range(_LEVELS):
        heights = np.linspace(low, high, _GRID)
        shape = np.maximum(heights[:, None] - place, 0.0)
        shape *= np.sqrt(shape)
        size = np.einsum("ij,ij->i", shape, shape)
        across = shape @ basis
        square = size - np.einsum("ij,ij->i", across, across)
        product = shape @ rest
        rises = (square > 1e-9 * size) & (product > 0.0)
        gains = np.where(rises, product**2 / np.where(rises, square, 1.0), 0.0)
        at = int(np.argmax(gains))
        if gains[at] > best[0]:
            best = float(gains[at]), float(heights[at]), float(product[at] / square[at])
        low, high = float(heights[max(at - 1, 0)]), float(heights[min(at + 1, _GRID - 1)])
    gain, surface, slope = best
    if gain <= 0.0:
        return None
    law = slope * np.maximum(surface - place, 0.0) ** 1.5
    law -= basis @ (basis.T @ law)
    return surface, gain, float(np.ptp(law)), rest - law, basis, rest


def _basis(terms: list[Floats]) -> Floats:
    """Orthonormal columns (n, k) that span some terms: at a constant speed travel is time."""
    left, sizes, _ = np.linalg.svd(np.column_stack([term / (np.linalg.norm(term) or 1.0) for term in terms]), False)
    return np.asarray(left[:, sizes > _ALIKE * sizes[0]], float)


def _fitted(terms: list[Floats], force: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(np.column_stack(terms), force, rcond=None)[0], float)


def _as_one(residual: Floats) -> float:
    """Return how many readings count as one."""
    return max((samples_as_one(residual, parts) for parts in _PARTS if len(residual) >= parts), default=1.0)
