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

LAGS, PHASES, BLOCKS, DEPTHS = 50, 32, 20, 10  # lags of the autocorrelation; bins of phase, time and depth
# Lags that say nothing of the model: the tip's inertia is taken off by a slope of the velocity over 11 samples, which
# an arm that is commanded unevenly does not follow, and readings between two samples are shared by both.
_NEAR_SAMPLES = 10  # samples, within which the channel itself remembers
_BLOCK_LAGS = 20  # blocks of `_NEAR_SAMPLES` samples, where no standstill shows the channel's own memory
_MIN_BIN_SAMPLES = 8  # samples of a bin, for its mean to be nearly normal
_MIN_LINE_SHARE = 0.5  # of the motion's variance in one line of its spectrum, from which on it oscillates
_MIN_CYCLES = 4.0  # of an oscillation in the record


@dataclass(frozen=True)
class WhitenessTest:
    """p-values of one track."""

    p: float  # of the family: the smallest after Holm
    tests: Mapping[str, float]  # by name, as they are
    misfit: float = 0.0  # share of the variance that is a pattern: by memory, phase, time or depth, the largest of them
    chance: float = 0.0  # two standard deviations of the misfit, without a pattern
    null: str = "assumed"  # where the noise comes from: "standstill", "residual", or white noise "assumed"


def whiteness_tests(
    values: Floats, runs: Runs, time: Floats, depth: Floats, phase: Floats | None, null: Null
) -> WhitenessTest:
    """Return the tests of residuals or innovations (n,) of any scale, against the noise that `null` gives.

    `runs` (n,) numbers the stretches without a gap, `phase` (n,) [rad] is that of the oscillation, None without
    one. The whitened values are clipped at 6 standard deviations. Under a null that comes from n0 samples whitening
    leaves a memory of the order 1/n0, so that the Ljung-Box sum is divided by 1 + n/n0 where it has whitened anything,
    and the sums of means by `null.excess`.
    Sources: Bartlett 1946; Ljung and Box 1978; Holm 1979.
    """
    known_runs = runs
    white, known = null.whitened(values, runs)
    white, runs, time, depth = white[known], runs[known], time[known], depth[known]
    if len(white) < 4 * LAGS or deviation(white) == 0.0:
        return WhitenessTest(1.0, {}, 0.0, 0.0, null.source)
    white = without_outliers(white)
    white = white / np.sqrt(np.mean(white**2))
    tests, patterns = {}, {}
    if null.source == "residual":  # whitened by themselves they have no memory left to test
        tests["memory"], patterns["memory"] = _slow_memory(values, known_runs)
    else:
        tests["memory"], patterns["memory"] = _memory(white, runs, null)
    order = np.argsort(np.argsort(depth, kind="stable"), kind="stable")
    bins = {"time": (np.arange(len(white)) * BLOCKS // len(white), BLOCKS)}
    bins["depth"] = (order * DEPTHS // len(white), DEPTHS)
    if phase is not None:
        bins["phase"] = (np.floor(phase[known] / (2 * np.pi) * PHASES).astype(int) % PHASES, PHASES)
    for name, (places, count) in bins.items():
        tests[name], patterns[name] = _means(white, places, count, null.excess)
    tests["depth"] = _means(np.sign(white), *bins["depth"], null.excess)[0]
    chance = 2.0 * float(np.sqrt(2.0 * PHASES)) * null.excess / len(white)
    return WhitenessTest(min(1.0, len(tests) * min(tests.values())), tests, max(patterns.values()), chance, null.source)


def _memory(white: Floats, runs: Runs, null: Null) -> tuple[float, float]:
    """p of Ljung and Box's test over 50 lags, within the runs, and the power of a slow sine that would give it.

    The lags begin beyond those at which the channel, and not the model, correlates; by Bartlett's formula that scatters
    the others by 1 + 2 sum r_k^2. A sine of power s in noise of power 1 - s correlates by s cos(w k): over m lags the
    sum is n m s^2/2.
    """
    n, power = len(white), float((white**2).sum())
    total = near = 0.0
    for lag in range(1, _NEAR_SAMPLES + LAGS + 1):
        together = runs[lag:] == runs[:-lag]
        pairs = int(np.count_nonzero(together))
        if not pairs:
            continue
        share = float((white[lag:] * white[:-lag])[together].sum()) / power
        if lag <= _NEAR_SAMPLES:
            near += share**2
        else:
            total += n * (n + 2.0) / pairs * share**2
    total /= 1.0 + 2.0 * near
    if len(null.coefficients):
        total /= 1.0 + n / max(null.samples, 1)
    return float(chance_of_more(LAGS, total)), float(np.sqrt(max(2.0 * (total - LAGS), 0.0) / (n * LAGS)))


def _slow_memory(values: Floats, runs: Runs) -> tuple[float, float]:
    """As `_memory` of values that nothing at rest is known of: of the means of blocks, but for neighbouring ones.

    A channel hangs together for some samples, and no noise at rest says for how many: what hangs together for longer
    than two blocks of 10 samples is not the channel.
    """
    blocks = np.flatnonzero(
        runs[_NEAR_SAMPLES - 1 :: _NEAR_SAMPLES] == runs[: len(runs) - _NEAR_SAMPLES + 1 : _NEAR_SAMPLES]
    )
    means = values[: len(values) // _NEAR_SAMPLES * _NEAR_SAMPLES].reshape(-1, _NEAR_SAMPLES).mean(axis=1)[blocks]
    means = means[np.isfinite(means)]
    if len(means) < 4 * _BLOCK_LAGS:
        return 1.0, 0.0
    limit = OUTLIER * deviation(means)
    means = np.clip(means - means.mean(), -limit, limit)
    n, power = len(means), max(float((means**2).sum()), 1e-300)
    shares = [float((means[lag:] * means[:-lag]).sum()) / power for lag in range(1, _BLOCK_LAGS + 2)]
    total = sum(n * (n + 2.0) / (n - lag) * share**2 for lag, share in enumerate(shares[1:], start=2))
    total /= 1.0 + 2.0 * shares[0] ** 2
    of_all = float(np.var(means)) / max(float(np.nanvar(values)), 1e-300)
    return (
        float(chance_of_more(_BLOCK_LAGS, total)),
        of_all * float(np.sqrt(max(2.0 * (total - _BLOCK_LAGS), 0.0) / (n * _BLOCK_LAGS))),
    )


def _means(white: Floats, bins: NDArray[np.int64], count: int, excess: float) -> tuple[float, float]:
    """p of the means over bins, of values of variance 1 and mean 0 under the null, and the power of their pattern."""
    number = np.bincount(bins, minlength=count)
    sums = np.bincount(bins, weights=white, minlength=count)
    enough = number >= _MIN_BIN_SAMPLES
    freedom = max(int(np.count_nonzero(enough)), 1)
    total = float((sums[enough] ** 2 / number[enough]).sum())
    return float(chance_of_more(freedom, total / excess)), max(total - excess * freedom, 0.0) / len(white)


def oscillation(time: Floats, position: Floats) -> tuple[float, Floats] | None:
    """Frequency [Hz] and phase (n,) [rad] of a motion that mostly oscillates with one frequency; else None.

    The strongest line of the periodogram, refined by least squares of a sine; it must hold half of the variance. Many
    runs of one record in one process ask it once.
    """
    found = _oscillation(np.asarray(time, np.float64).tobytes(), np.asarray(position, np.float64).tobytes())
    return None if found is None else (found[0], found[1].copy())


@lru_cache(maxsize=4)
def _oscillation(times: bytes, positions: bytes) -> tuple[float, Floats] | None:
    time, position = (np.frombuffer(part, np.float64) for part in (times, positions))
    if len(time) < 4 * LAGS or not np.isfinite(position).all():
        return None
    span = float(time[-1] - time[0])
    even = np.linspace(float(time[0]), float(time[-1]), min(len(time), 16384))
    level = np.interp(even, time, position)
    level = level - np.polyval(np.polyfit(even - even[0], level, 1), even - even[0])
    variance = float(np.mean(level**2))
    if variance == 0.0:
        return None
    spectrum = np.abs(np.fft.rfft(level * np.hanning(len(level)), 4 * len(level)))
    peak = int(np.argmax(spectrum[1:])) + 1
    lines = (peak + np.linspace(-4, 4, 81)) / (4 * span)
    best = float(lines[int(np.argmax(_powers(even, level, lines)))])
    power, angle = _sine(even, level, best)
    if power < _MIN_LINE_SHARE * variance or best * span < _MIN_CYCLES:
        return None
    return best, np.mod(2 * np.pi * best * (time - even[0]) + angle, 2 * np.pi)


def _powers(time: Floats, level: Floats, lines: Floats) -> Floats:
    """Variance that a sine takes (m,) of each of frequencies at equal steps, by least squares."""
    since = 2j * np.pi * (time - time[0])
    wave, turn = np.exp(lines[0] * since), np.exp((lines[1] - lines[0]) * since)
    found = np.empty(len(lines))
    for k in range(len(lines)):
        square, product = wave @ wave, wave @ level
        even, odd, mixed = 0.5 * (len(time) + square.real), 0.5 * (len(time) - square.real), 0.5 * square.imag
        left, right = product.real, product.imag
        across = even * odd - mixed**2
        if across > 0:
            cosine = (odd * left - mixed * right) / across
            sine = (even * right - mixed * left) / across
            found[k] = (cosine**2 + sine**2) / 2
        else:
            found[k] = 0.0
        wave = wave * turn
    return found


def _sine(time: Floats, level: Floats, frequency: float) -> tuple[float, float]:
    """Variance that a sine of a frequency takes, and its phase [rad] at the beginning."""
    angle = 2 * np.pi * frequency * (time - time[0])
    columns = np.column_stack([np.sin(angle), np.cos(angle)])
    (a, b), *_ = np.linalg.lstsq(columns, level, rcond=None)
    return float(a * a + b * b) / 2, float(np.arctan2(b, a))
