"""Four tests of residuals or innovations: their memory, and their means over phase, time and depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_uncertainty.channel_noise import OUTLIER, Null, Runs, deviation, without_outliers
from palpate_uncertainty.chi_square import chance_of_more

# A pattern shows by any number of lags and bins; the fewest values guard short records.
LAGS, PHASES, BLOCKS, DEPTHS = 50, 32, 20, 10  # lags of the autocorrelation; bins of phase, time and depth
# Lags that say nothing of the model: the tip's inertia is taken off by a slope of the velocity over 11 samples, which
# an arm that is commanded unevenly does not follow, and readings between two samples are shared by both.
_NEAR_SAMPLES = 10  # samples, within which the channel itself remembers
_BLOCK_LAGS = 20  # blocks of `_NEAR_SAMPLES` samples, a choice, where no standstill shows the channel's own memory
_MIN_VALUES_PER_LAG = 4  # values or blocks for each lag of an autocorrelation that is tested, a choice
_MIN_BIN_SAMPLES = 8  # samples of a bin, for its mean to be nearly normal, a choice
_MIN_LINE_SHARE = 0.5  # of the motion's variance in one line of its spectrum, from which on it oscillates, a choice
_MIN_CYCLES = 4.0  # of an oscillation in the record, a choice
_MAX_EVEN_SAMPLES = 16384  # that the spectrum of a motion is taken from, a choice of time
_ZERO_PADDING = 4  # lengths of the record in its padded spectrum, a choice, whose lines are 1/(4 span) apart
_FINE_LINES = np.linspace(-4, 4, 81)  # [padded lines] around the highest that least squares tries, a choice
_SMALLEST_POWER = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class WhitenessTest:
    """p-values of one track."""

    p: float  # of all tests together: the smallest, times their number (Holm 1979)
    tests: Mapping[str, float]  # p of each test by its name, not corrected for their number
    misfit: float = 0.0  # share of the variance that is a pattern: by memory, phase, time or depth, the largest of them
    chance: float = 0.0  # two standard deviations of the misfit, without a pattern
    null: str = "assumed"  # where the noise comes from: "standstill", "residual", or white noise "assumed"


def whiteness_tests(values: Floats, runs: Runs, depth: Floats, phase: Floats | None, null: Null) -> WhitenessTest:
    """Return the tests of residuals or innovations (n,) of any scale, against the noise that `null` gives.

    `runs` (n,) numbers the stretches without a gap, `depth` (n,) is any number that rises with the depth, `phase` (n,)
    [rad] that of the oscillation, None without one. The whitened values are clipped at 6 standard deviations. Tested
    are their memory, their means over 20 blocks of time and 32 phases, and their signs over 10 parts of the depth, each
    block or part with as many samples (decision 0110). Each pattern has a share of the variance, the largest of which
    is the misfit; the share by depth is that of the values, whose test by signs no outlier decides.
    p is 1 for less than 200 values.
    Sources: Bartlett 1946; Ljung and Box 1978; Holm 1979.
    """
    whitened, has_past = null.whitened(values, runs)
    white = whitened[has_past]
    n = len(white)
    if n < _MIN_VALUES_PER_LAG * LAGS or deviation(white) == 0.0:
        return WhitenessTest(p=1.0, tests={}, misfit=0.0, chance=0.0, null=null.source)
    white = without_outliers(white)
    white = white / np.sqrt(np.mean(white**2))
    tests, patterns = {}, {}
    # Memory; a residual that its own autoregression has whitened has none left to test.
    if null.source == "residual":
        tests["memory"], patterns["memory"] = _slow_memory(values, runs)
    else:
        tests["memory"], patterns["memory"] = _memory(white, runs[has_past], null)
    # Means over bins.
    time_blocks = np.arange(n) * BLOCKS // n
    depth_ranks = np.argsort(np.argsort(depth[has_past], kind="stable"), kind="stable")
    depth_parts = depth_ranks * DEPTHS // n
    tests["time"], patterns["time"] = _means(white, time_blocks, BLOCKS, null.excess)
    _, patterns["depth"] = _means(white, depth_parts, DEPTHS, null.excess)
    tests["depth"], _ = _means(np.sign(white), depth_parts, DEPTHS, null.excess)
    if phase is not None:
        phase_bins = np.floor(phase[has_past] / (2 * np.pi) * PHASES).astype(int) % PHASES
        tests["phase"], patterns["phase"] = _means(white, phase_bins, PHASES, null.excess)
    p = min(1.0, len(tests) * min(tests.values()))
    # Two standard deviations of the share by phase: the sum over 32 phases, a chi square, has that of sqrt(2 * 32).
    chance = 2.0 * float(np.sqrt(2.0 * PHASES)) * null.excess / n
    return WhitenessTest(p=p, tests=tests, misfit=max(patterns.values()), chance=chance, null=null.source)


def _memory(white: Floats, runs: Runs, null: Null) -> tuple[float, float]:
    """Return p of Ljung and Box's test over 50 lags, within the runs, and the power of a slow sine that would give it.

    `null` is the noise that has whitened the values. With n values, n_k pairs at lag k, and their autocorrelations r_k,
    the statistic is

        Q = n (n + 2) sum_(k = 11 .. 60) r_k^2/n_k  /  ((1 + 2 sum_(k = 1 .. 10) r_k^2) (1 + n/n0)).

    The first 10 lags are those at which the channel, and not the model, correlates; Bartlett's formula (1946) has what
    they add to the variance of the others. A noise taken from n0 samples leaves a memory of the order 1/n0 where it
    whitens. A sine of power s in noise of power 1 - s correlates by s cos(w k): over m lags Q is n m s^2/2.
    """
    n, power = len(white), float((white**2).sum())
    statistic = near_squares = 0.0
    for lag in range(1, _NEAR_SAMPLES + LAGS + 1):
        in_one_run = runs[lag:] == runs[:-lag]
        pairs = int(np.count_nonzero(in_one_run))
        if not pairs:
            continue
        autocorrelation = float((white[lag:] * white[:-lag])[in_one_run].sum()) / power
        if lag <= _NEAR_SAMPLES:
            near_squares += autocorrelation**2
        else:
            statistic += n * (n + 2.0) / pairs * autocorrelation**2
    statistic /= 1.0 + 2.0 * near_squares
    if len(null.coefficients):
        statistic /= 1.0 + n / max(null.samples, 1)
    return float(chance_of_more(LAGS, statistic)), _sine_power(statistic, LAGS, n)


def _sine_power(statistic: float, lags: int, count: int) -> float:
    """Return the power of a slow sine, of the variance of `count` values, that explains Ljung and Box's statistic."""
    return float(np.sqrt(max(2.0 * (statistic - lags), 0.0) / (count * lags)))


def _slow_memory(values: Floats, runs: Runs) -> tuple[float, float]:
    """Return p and power as `_memory` does, where no noise at standstill was recorded.

    A channel correlates over some samples, and without a standstill their number is not known. So the means of blocks
    of 10 samples are tested at the lags 2 to 21: what correlates for longer than two blocks is not the channel.
    """
    # Means of the blocks that lie within a run, outliers brought back.
    first_runs = runs[: len(runs) - _NEAR_SAMPLES + 1 : _NEAR_SAMPLES]
    last_runs = runs[_NEAR_SAMPLES - 1 :: _NEAR_SAMPLES]
    blocks = values[: len(values) // _NEAR_SAMPLES * _NEAR_SAMPLES].reshape(-1, _NEAR_SAMPLES)
    means = blocks.mean(axis=1)[np.flatnonzero(last_runs == first_runs)]
    means = means[np.isfinite(means)]
    n = len(means)
    if n < _MIN_VALUES_PER_LAG * _BLOCK_LAGS:
        return 1.0, 0.0
    limit = OUTLIER * deviation(means)
    means = np.clip(means - means.mean(), -limit, limit)
    # Ljung and Box's statistic, with Bartlett's variance by the lag that is left out.
    power = max(float((means**2).sum()), _SMALLEST_POWER)
    autocorrelations = [float((means[lag:] * means[:-lag]).sum()) / power for lag in range(1, _BLOCK_LAGS + 2)]
    statistic = sum(n * (n + 2.0) / (n - lag) * r**2 for lag, r in enumerate(autocorrelations[1:], start=2))
    statistic /= 1.0 + 2.0 * autocorrelations[0] ** 2
    # The power of the sine counts of the variance of all values, not of that of the means.
    share_of_means = float(np.var(means)) / max(float(np.nanvar(values)), _SMALLEST_POWER)
    return float(chance_of_more(_BLOCK_LAGS, statistic)), share_of_means * _sine_power(statistic, _BLOCK_LAGS, n)


def _means(white: Floats, bins: NDArray[np.int64], count: int, excess: float) -> tuple[float, float]:
    """Return p of the means over bins, and the power of their pattern, of values of mean 0 and variance 1.

    Over the m bins of at least 8 values the sum of (sum of a bin)^2/(its number) is a chi square of m degrees of
    freedom under the null, times the `excess` that slow means of a whitened noise have.
    """
    numbers = np.bincount(bins, minlength=count)
    sums = np.bincount(bins, weights=white, minlength=count)
    is_full = numbers >= _MIN_BIN_SAMPLES
    freedom = max(int(np.count_nonzero(is_full)), 1)
    statistic = float((sums[is_full] ** 2 / numbers[is_full]).sum())
    return float(chance_of_more(freedom, statistic / excess)), max(statistic - excess * freedom, 0.0) / len(white)


def oscillation(time: Floats, position: Floats) -> tuple[float, Floats] | None:
    """Return frequency [Hz] and phase (n,) [rad] of a motion that mostly oscillates with one frequency; else None.

    The strongest line of the periodogram, refined by least squares of a sine; it must hold half of the variance and
    have at least 4 cycles. Many runs of one record in one process compute it once.
    """
    oscillating = _oscillation(np.asarray(time, np.float64).tobytes(), np.asarray(position, np.float64).tobytes())
    if oscillating is None:
        return None
    frequency, phase = oscillating
    return frequency, phase.copy()


@lru_cache(maxsize=4)  # several diagnoses of a track ask
def _oscillation(times: bytes, positions: bytes) -> tuple[float, Floats] | None:
    """Return the `oscillation` of the bytes of times [s] and positions [m], which a cache takes as keys."""
    time, position = np.frombuffer(times, np.float64), np.frombuffer(positions, np.float64)
    if len(time) < _MIN_VALUES_PER_LAG * LAGS or not np.isfinite(position).all():
        return None
    # The motion at equal steps, less its straight line.
    span = float(time[-1] - time[0])
    even_time = np.linspace(float(time[0]), float(time[-1]), min(len(time), _MAX_EVEN_SAMPLES))
    motion = np.interp(even_time, time, position)
    motion = motion - np.polyval(np.polyfit(even_time - even_time[0], motion, 1), even_time - even_time[0])
    variance = float(np.mean(motion**2))
    if variance == 0.0:
        return None
    # The highest line of a padded spectrum but for the first, the mean; then, of the frequencies next to it, the one
    # whose sine fits best.
    spectrum = np.abs(np.fft.rfft(motion * np.hanning(len(motion)), _ZERO_PADDING * len(motion)))
    peak = int(np.argmax(spectrum[1:])) + 1
    candidates = (peak + _FINE_LINES) / (_ZERO_PADDING * span)
    frequency = float(candidates[int(np.argmax(_powers(even_time, motion, candidates)))])
    power, angle = _sine(even_time, motion, frequency)
    if power < _MIN_LINE_SHARE * variance or frequency * span < _MIN_CYCLES:
        return None
    return frequency, np.mod(2 * np.pi * frequency * (time - even_time[0]) + angle, 2 * np.pi)


def _powers(time: Floats, level: Floats, lines: Floats) -> Floats:
    """Return the variance (m,) that a sine takes of each of frequencies [Hz] at equal steps, by least squares.

    `level` (n,) are the values. With z = exp(i w t), the normal equations of the cosine and the sine are made of z^T z
    and z^T level:

        sum cos^2 = (n + Re z^T z)/2,  sum sin^2 = (n - Re z^T z)/2,  sum cos sin = Im z^T z/2.
    """
    # i w t for 1 Hz; from one frequency to the next, z is multiplied by the same factors.
    since = 2j * np.pi * (time - time[0])
    wave, turn = np.exp(lines[0] * since), np.exp((lines[1] - lines[0]) * since)
    powers = np.zeros(len(lines))
    for k in range(len(lines)):
        square, product = wave @ wave, wave @ level
        cos_cos, sin_sin, cos_sin = 0.5 * (len(time) + square.real), 0.5 * (len(time) - square.real), 0.5 * square.imag
        determinant = cos_cos * sin_sin - cos_sin**2
        if determinant > 0:
            cosine = (sin_sin * product.real - cos_sin * product.imag) / determinant
            sine = (cos_cos * product.imag - cos_sin * product.real) / determinant
            powers[k] = (cosine**2 + sine**2) / 2
        wave = wave * turn
    return powers


def _sine(time: Floats, level: Floats, frequency: float) -> tuple[float, float]:
    """Return the variance that a sine of a frequency [Hz] takes, and its phase [rad] at the beginning."""
    angle = 2 * np.pi * frequency * (time - time[0])
    columns = np.column_stack([np.sin(angle), np.cos(angle)])
    (a, b), *_ = np.linalg.lstsq(columns, level, rcond=None)
    return float(a * a + b * b) / 2, float(np.arctan2(b, a))
