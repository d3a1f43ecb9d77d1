"""Depth rate and acceleration of a recorded motion, without delay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats, Samples

from palpate_kit.numerics.local_cubic import cubic_weights, local_cubic

_SHORTEST = 5  # samples, the fewest odd ones that a cubic does not pass through
_LONGEST = 0.2  # [s] that the window is widened to by itself: a choice
_NOISE_SHARE = 0.02  # of the RMS rate, below which noise of the rate no longer bends an estimate
_MAX_BLUR = 0.01  # of a viscosity; a third of the smallest uncertainty that one is given
_SIGNIFICANT = 3.0  # standard errors, a choice, beyond which a slope is not by chance
_FORGOTTEN = 10.0  # over the rate at which the fastest state forgets: the window that such a model may have; a choice
_SHALLOW = 0.2  # of the depth that is reached: where it is the fastest; a choice
_REACH, _MAX_SHALLOW = 5e-3, 1e-3  # [m] of a robot: where no record says how deep it goes, and however deep that is
_GAP = 5.0  # median intervals, from which on a pause is a gap: a choice
_MIN_WINDOWS = 10  # side by side, for their median: a choice
_MEDIAN = 0.6745  # of the absolute value of noise, in standard deviations
_INSIDE = 0.4  # of the longest such window: what a local cubic blurs goes with its fourth power
_CLEAR = 1.3  # of that median; more is a motion that a cubic does not follow
_AT_ONCE = 65_536  # samples whose differences are taken at once, 0.5 MB: a choice, for speed
_THIRD_DIFFERENCE = 20.0  # variance of third differences of white noise of variance 1: 1 + 9 + 9 + 1
_GROWTH, _GROWTH_SAMPLES = 1.2, 2  # from one width that is tried to the next: a choice
_DEGREE = 4  # of the polynomial that a cubic lacks first
_MIN_SPEED = 1e-300  # [m/s] guards against a division by 0


@dataclass(frozen=True)
class TipTravel:
    """Motion of the tip in the direction of depth."""

    rate: Floats  # (n,) d' [m/s]
    acceleration: Floats  # (n,) d'' [m/s^2]
    window: float  # [s] of the local polynomial
    rate_noise: float = 0.0  # [m/s] standard deviation of the noise that is left in the rate


def zero_phase_motion(samples: Samples, window: float | None, longest: float = _LONGEST) -> TipTravel:
    """Return rate and acceleration by local cubics over a symmetric window [s] (Savitzky and Golay 1964).

    The rate joins the slope of the position and the smoothed velocity, each weighted by the inverse variance of its
    noise, which third differences show. Noise of the rate lowers a viscosity (errors in variables) by its share of the
    rate's mean square, so without a given window the shortest one is taken that keeps this share below 0.04 %, but none
    above the `longest` [s].
    """
    interval = _usual(samples)
    noise = noise_of(samples.position, samples.time), noise_of(samples.velocity, samples.time)
    if window is not None:
        return _motion(samples, interval, _odd(window / interval), noise)
    is_measured = np.isfinite(samples.velocity)
    # Root mean square of the velocity, which the noise of the rate is compared with.
    squares = float(np.add.reduce(np.where(is_measured, samples.velocity, 0.0) ** 2))
    speed = float(np.sqrt(squares / max(int(np.count_nonzero(is_measured)), 1)))
    width = _width(noise, speed, interval, min(longest, _LONGEST))
    return _least_blurred_motion(samples, interval, width, noise, speed)


def _least_blurred_motion(
    samples: Samples, interval: float, width: int, noise: tuple[float, float], speed: float
) -> TipTravel:
    """Return the motion over at most `width` samples; over fewer where blurring costs a viscosity more than noise does.

    `noise` is that of height [m] and velocity [m/s], `speed` [m/s] the rms velocity. Third differences take a sine of
    few samples a period for noise, and a window made for that noise flattens it; so does a velocity by central
    differences, which is left out last of all. The blur of a motion is the share by which a viscosity would be too
    high, against the sharp rate of the shortest local cubics.
    """
    motion = _motion(samples, interval, width, noise)
    by_position = noise[0], np.inf  # a velocity of infinite noise has no weight
    sharp_rate = _sharp_rate(samples, interval)
    sharper = [(w, noise) for w in reversed(_widths(width)) if w < width] + [(_SHORTEST, by_position)]
    # Narrower widths, the widest first, and last the shortest one without the velocity.
    for narrower, its_noise in sharper:
        blur = _blur(sharp_rate, motion.rate)
        if blur < max(_MAX_BLUR, (_rate_noise(its_noise, narrower, interval) / max(speed, _MIN_SPEED)) ** 2):
            break
        motion = _motion(samples, interval, narrower, its_noise)
    return motion


def _sharp_rate(samples: Samples, interval: float) -> Floats:
    """Return the rate (n,) [m/s] by the shortest local cubics through the positions alone; 0 in stretches that are
    shorter."""
    rate = np.zeros(len(samples))
    for rows in _stretches(samples.interval, interval):
        if rows.stop - rows.start >= _SHORTEST:
            step = local_cubic(samples.time[rows], _SHORTEST, 1)
            rate[rows] = -local_cubic(samples.position[rows], _SHORTEST, 1) / step
    return rate


def _blur(sharp_rate: Floats, rate: Floats) -> float:
    """Return the share by which a viscosity would be too high since `rate` (n,) [m/s] is a smoothed `sharp_rate` (n,)
    [m/s].

    The slope of the sharp rate over the smooth one, less 1 and less three of its standard errors. White noise adds
    nothing: a wider window of least squares has no less variance than its covariance with a narrower one.
    """
    square = float(rate @ rate)
    if not square > 0:
        return 0.0
    slope = float(sharp_rate @ rate) / square
    residual = sharp_rate - slope * rate
    # Neighbours share a window: of so many samples the errors count once.
    standard_error = np.sqrt(_SHORTEST * float(residual @ residual) / square / len(rate))
    return slope - 1.0 - _SIGNIFICANT * float(standard_error)


def _widths(longest: int) -> list[int]:
    """Return the widths [samples] that are tried, from the shortest to `longest`."""
    widths = [_SHORTEST]
    while widths[-1] < longest:
        widths.append(_wider(widths[-1]))
    return widths


def _width(noise: tuple[float, float], speed: float, interval: float, longest: float) -> int:
    """Return the samples of the shortest window that keeps the noise of the rate below a share of the usual speed
    [m/s]."""
    width = _SHORTEST
    while width * interval < longest and _rate_noise(noise, width, interval) > _NOISE_SHARE * speed:
        width = _wider(width)
    return width


def rate_kernels(
    noise: tuple[float, float], speed: float, interval: float, channel: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the kernels by which `zero_phase_motion` convolves heights and speeds into rate and acceleration.

    In this order: rate by heights [1/s], rate by speeds [1], acceleration by heights [1/s^2], and by speeds [1/s].

    `noise` of height [m] and speed [m/s], usual `speed` [m/s], `interval` [s] of the samples; without a `channel` of
    the velocity a speed is the central difference of the heights.
    """
    width = _width(noise, speed, interval, _LONGEST)
    slope, smooth = cubic_weights(width, 1) / interval, cubic_weights(width)
    variances = _variances(noise, width, interval)
    velocity_weight = variances[0] / sum(variances) if np.isfinite(sum(variances)) and sum(variances) > 0 else 0.0
    by_height = np.pad((1.0 - velocity_weight) * slope, 1)
    if not channel:
        by_height = by_height + velocity_weight * np.convolve(smooth, np.array([1.0, 0.0, -1.0]) / (2.0 * interval))
    by_speed = velocity_weight * smooth * float(channel)
    return by_height, by_speed, np.convolve(by_height, slope), np.convolve(by_speed, slope)


def longest_window(model: ContactModel, depth: float = _REACH) -> float:
    """Return the longest window [s] of a motion's derivatives that does not blur the states of a model.

    It is ten times the time in which the fastest state forgets, at a fifth of the `depth` [m] (but at most 1 mm), with
    the parameters at which a search begins; without states the usual longest one. States average the rate themselves:
    its noise bends them less than what is blurred at a touch does.
    """
    if not model.memory:
        return _LONGEST
    guess = [1.0 if parameter.start is None else parameter.start for parameter in model.parameters]
    ones, count = [1.0] * len(model.memory), len(model.memory)
    shallow = min(_SHALLOW * depth, _MAX_SHALLOW)
    # The rate of a state is linear in it: the difference for states of 1 and 0 is how fast it forgets.
    ends = (model.memory_rate(shallow, 0.0, guess, state) for state in (ones, [0.0] * count))
    forgetting = np.abs(np.subtract(*(np.array(end, float) for end in ends)))
    return _FORGOTTEN / float(forgetting.max()) if forgetting.max() > 0 else _LONGEST


def cubic_window(samples: Samples) -> float:
    """Return the window [s] in which the motion is a cubic far within its noise, so that a local cubic does not blur
    it.

    0.4 of the longest that shows no more than noise in the degree 4 of the heights in windows side by side, and so a
    fortieth of what may hide there; by the median, for corners are few among them.
    """
    interval, noise, width = _usual(samples), noise_of(samples.position, samples.time), _SHORTEST
    while (wider := _wider(width)) * interval < _LONGEST and len(samples) >= _MIN_WINDOWS * wider:
        fourth = samples.position[: len(samples) // wider * wider].reshape(-1, wider) @ _fourth_degree(wider)
        if median(np.abs(fourth)) > _MEDIAN * _CLEAR * noise:
            break
        width = wider
    return _odd(_INSIDE * width) * interval


@cache
def _fourth_degree(width: int) -> Floats:
    """Return the polynomial of degree 4 (width,) that is orthogonal to those below it, of length 1."""
    powers = np.linspace(-1.0, 1.0, width)[:, None] ** np.arange(_DEGREE + 1)
    return np.asarray(np.linalg.qr(powers)[0][:, _DEGREE])


def smooth_height(samples: Samples, window: float) -> Floats:
    """Return the height (n,) [m] by local cubics over a symmetric window [s]; between gaps each stretch by itself."""
    interval, smooth = _usual(samples), samples.position.copy()
    for rows in _stretches(samples.interval, interval):
        width = min(_odd(window / interval), (rows.stop - rows.start - 1) // 2 * 2 + 1)
        if width >= _SHORTEST:
            smooth[rows] = local_cubic(samples.position[rows], width)
    return smooth


def _usual(samples: Samples) -> float:
    """Return the median interval [s] between samples."""
    interval = median(samples.interval[1:]) if len(samples) > 1 else 1.0
    return interval if interval > 0 else 1.0


def median(values: Floats) -> float:
    """Return the median of values (n,) without NaN, n > 0; numpy's own takes five times as long over a thousand."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    ordered = np.partition(values, (low, high))
    return 0.5 * float(ordered[low] + ordered[high])


def _wider(width: int) -> int:
    """Return the next width [samples] that is tried."""
    return _odd(_GROWTH * width + _GROWTH_SAMPLES)


def _odd(width: float) -> int:
    """Return the odd number of samples of a window, at least the shortest."""
    return max(int(width) // 2 * 2 + 1, _SHORTEST)


def noise_of(values: Floats, time: Floats | None = None) -> float:
    """Return the standard deviation [as values] of white noise that would give the third differences of a record.

    With the time (n,) [s] of each value, differences across gaps do not count.
    """
    across = None if time is None else _across_gaps(time)
    total, count = 0.0, 0
    # n values have n - 3 third differences.
    for start in range(0, max(len(values) - 3, 0), _AT_ONCE):
        differences = third_differences(values[start : start + _AT_ONCE + 3])
        if across is not None and across.any():
            differences = differences[~across[start : start + _AT_ONCE]]
        square = float(np.add.reduce(differences * differences))
        if not np.isfinite(square):
            differences = differences[np.isfinite(differences)]
            square = float(np.add.reduce(differences * differences))
        total, count = total + square, count + len(differences)
    return float(np.sqrt(total / count / _THIRD_DIFFERENCE)) if count else np.inf


def _across_gaps(time: Floats) -> NDArray[np.bool_]:
    """Return True (n - 3,) for each four neighbours with a gap between two of them."""
    intervals = np.diff(time)
    if len(intervals) < 3:
        return np.zeros(max(len(time) - 3, 0), bool)
    is_gap = intervals > _GAP * median(intervals)
    return np.asarray(is_gap[:-2] | is_gap[1:-1] | is_gap[2:])


def third_differences(values: Floats) -> Floats:
    """Return what `numpy.diff` of order 3 does along the last axis."""
    for _ in range(3):
        values = values[..., 1:] - values[..., :-1]
    return values


def _variances(noise: tuple[float, float], width: int, interval: float) -> tuple[float, float]:
    """Return the variance of the rate [(m/s)^2] from the slope of the position, and from the smoothed velocity."""
    return (noise[0] / interval * _length(width, 1)) ** 2, (noise[1] * _length(width, 0)) ** 2


@cache
def _length(width: int, derivative: int) -> float:
    """Return by how much a local cubic multiplies the standard deviation of white noise."""
    return float(np.linalg.norm(cubic_weights(width, derivative)))


def _rate_noise(noise: tuple[float, float], width: int, interval: float) -> float:
    """Return the standard deviation [m/s] of the rate by position and velocity, weighted by their inverse variances."""
    slope, value = _variances(noise, width, interval)
    if value == np.inf:
        return float(np.sqrt(slope))
    return float(np.sqrt(slope * value / (slope + value))) if slope + value > 0 else 0.0


def _motion(samples: Samples, interval: float, width: int, noise: tuple[float, float]) -> TipTravel:
    """Return the motion over windows of `width` samples, between gaps each stretch by itself.

    `samples` have time [s], position [m] and velocity [m/s], every `interval` [s]; `noise` is that of both. The rate is
    -[(1 - c) z' + c v], with c = s_z^2/(s_z^2 + s_v^2) by the variances of slope z' and smoothed velocity v. A stretch
    that is shorter than the shortest window has its velocity, and no acceleration.
    """
    count = len(samples)
    slope, smooth_velocity, acceleration = np.zeros(count), np.zeros(count), np.zeros(count)
    variances = _variances(noise, width, interval)
    total = sum(variances)
    velocity_weight = variances[0] / total if np.isfinite(total) and total > 0 else 0.0  # of the velocity
    for rows in _stretches(samples.interval, interval):
        # A stretch between gaps has a window of its own where it is shorter than the usual one.
        length = rows.stop - rows.start
        fitting = min(width, (length - 1) // 2 * 2 + 1)
        if fitting < _SHORTEST:
            slope[rows] = smooth_velocity[rows] = np.nan_to_num(samples.velocity[rows])
            continue
        # A local cubic over so many samples: its value (0), or its slope by sample (1).
        step = local_cubic(samples.time[rows], fitting, 1)
        slope[rows] = local_cubic(samples.position[rows], fitting, 1) / step
        velocity = samples.velocity[rows]
        smooth_velocity[rows] = local_cubic(np.where(np.isfinite(velocity), velocity, slope[rows]), fitting, 0)
        joined = (1 - velocity_weight) * slope[rows] + velocity_weight * smooth_velocity[rows]
        acceleration[rows] = local_cubic(joined, fitting, 1) / step
    # In place, for records are long: slope becomes the rate of the depth.
    slope *= velocity_weight - 1
    smooth_velocity *= velocity_weight
    slope -= smooth_velocity  # minus the rate of the height
    np.negative(acceleration, out=acceleration)
    return TipTravel(slope, acceleration, width * interval, _rate_noise(noise, width, interval))


def _stretches(intervals: Floats, usual: float) -> Iterator[slice]:
    """Yield the rows between gaps."""
    cuts = np.flatnonzero(intervals > _GAP * usual)
    cuts = cuts[cuts > 0]
    for first, last in zip([0, *cuts], [*cuts, len(intervals)], strict=True):
        if last > first:
            yield slice(int(first), int(last))
