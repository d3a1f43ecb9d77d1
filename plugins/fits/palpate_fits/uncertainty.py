"""Standard uncertainty of a fit from its residuals as they are: correlated from sample to sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_kit.numerics.tip_travel import third_differences

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual

_BLOCK = 1024  # neighbours are found within
_AT_ONCE = 8  # blocks
_FEW = 40  # lags, up to which sums are faster than Fourier transforms
_MOST = 200_000  # rows that the correlation sums run over; longer records are added up in pieces before
_MOST_TAKEN = 0.6  # of the sum of the autocorrelation; more cannot be made good
_SPAN = 5.0  # the correlation is summed up to so many of its own times (Sokal 1997)


@dataclass(frozen=True)
class ResidualScatter:
    """What the residuals at the minimum say."""

    covariance: Floats  # (p, p) of the free unknowns
    inverse_normal: Floats  # (p, p) (J^T J)^-1
    samples: int
    effective_samples: float  # independent samples that the correlated ones are worth
    correlation_time: float  # [samples] sum of the autocorrelation from -inf to inf
    first_correlation: float  # autocorrelation of neighbours
    rss: float  # [N^2] plain sum of squares
    noise: float  # [N] standard deviation of white noise that would give the residual's third differences


def scatter(residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> ResidualScatter:
    """Sandwich covariance A^-1 S A^-1, A = sum psi' J J^T, S = sum over pairs of gamma(i - j) J_i J_j^T.

    gamma is the autocovariance of the residuals, summed as far as it reaches; the white-noise formula is the case that
    gamma vanishes between samples.
    """
    pieces = _collect(residual, record, x, loss)
    p = len(residual.free)
    gamma, reach = _autocovariance(pieces.errors, p)
    inverse = scaled_inverse(pieces.normal)
    middle = _pair_sum(pieces.slopes, gamma, reach)
    covariance = inverse @ middle @ inverse
    if (middle.diagonal() < 0).any() or (covariance.diagonal() < 0).any():
        covariance = inverse @ _pair_sum(pieces.slopes, gamma, reach, tapered=True) @ inverse
    time = max(_long_run(gamma, reach) / gamma[0], 0.05) * pieces.size if gamma[0] > 0 else 1.0
    effective = min(pieces.samples / time, float(pieces.samples))
    return ResidualScatter(
        covariance, inverse, pieces.samples, effective, time, pieces.first_correlation, pieces.rss, pieces.noise
    )


@dataclass(frozen=True)
class _Pieces:
    """Residuals and slopes of a record, added up over `size` samples each."""

    errors: Floats  # (m,) sums of psi
    slopes: Floats  # (m, p) means
    normal: Floats  # (p, p)
    size: int
    samples: int
    rss: float
    first_correlation: float
    noise: float


def _collect(residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> _Pieces:
    p = len(residual.free)
    size = -(-len(record) // _MOST)
    normal, errors, slopes = np.zeros((p, p)), [], []
    rss = neighbours = third = 0.0
    thirds = samples = 0
    kept = np.zeros((0, 1 + p))
    everything = bool(record.used.all())
    for rows, values in residual.blocks(record, x, _BLOCK * _AT_ONCE if everything else _BLOCK):
        if not everything:
            values = values[record.used[rows]]
        samples += len(values)
        r, jacobian = values[:, 0], values[:, 1:]
        influence, curvature = loss.influence(r)
        normal += jacobian.T @ (jacobian if loss.kind == "linear" else jacobian * curvature[:, None])
        rss += float(r @ r)
        for stretch in _stretches(r):
            neighbours += float(np.sum(stretch[:, 1:] * stretch[:, :-1]))
            differences = third_differences(stretch)
            third, thirds = third + float(np.sum(differences * differences)), thirds + differences.size
        joined = np.column_stack([influence, jacobian])
        if size == 1:
            errors.append(joined[:, 0])
            slopes.append(joined[:, 1:])
            continue
        kept = np.concatenate([kept, joined])
        whole = len(kept) // size * size
        cut = kept[:whole].reshape(-1, size, 1 + p)
        errors.append(cut[:, :, 0].sum(axis=1))
        slopes.append(cut[:, :, 1:].mean(axis=1))
        kept = kept[whole:]
    first = neighbours / rss if rss > 0 else 0.0
    noise = float(np.sqrt(third / (20.0 * max(thirds, 1))))
    return _Pieces(np.concatenate(errors), np.concatenate(slopes), normal, size, samples, rss, first, noise)


def _stretches(values: Floats) -> Iterator[Floats]:
    """Values (n,) as stretches (m, _BLOCK) of neighbours, and what is left of them (1, rest)."""
    whole = len(values) // _BLOCK * _BLOCK
    if whole:
        yield values[:whole].reshape(-1, _BLOCK)
    if whole < len(values):
        yield values[None, whole:]


def _autocovariance(errors: Floats, fitted: int) -> tuple[Floats, int]:
    """Autocovariance (m // 4 + 1,), and the lag up to which it is more than noise (Sokal's window).

    A fit takes from its residuals what it can follow: with p parameters each lag is too small by p/m of the sum over
    all lags. That sum over the window is then too small by a factor 1 - p K/m, K the window's area, which is made good.
    """
    m = len(errors)
    length = _smooth_length(2 * m)
    spectrum = np.fft.rfft(errors, length)
    gamma: Floats = np.fft.irfft(np.abs(spectrum) ** 2, length)[: max(m // 4, 1) + 1] / m
    if gamma[0] <= 0:
        return gamma, 0
    time = 1.0 + 2.0 * np.cumsum(gamma[1:]) / gamma[0]
    enough = np.flatnonzero(np.arange(1, len(gamma)) >= _SPAN * time)
    reach = int(enough[0]) + 1 if len(enough) else len(gamma) - 1
    area = 2.0 * float(_weights(reach, len(gamma)).sum()) - 1.0
    taken = fitted / m * max(_long_run(gamma, reach), 0.0) / (1.0 - min(fitted * area / m, _MOST_TAKEN))
    return gamma + taken, reach


@lru_cache(256)
def _weights(reach: int, most: int, tapered: bool = False) -> Floats:
    """Flat up to the reach, then falling to 0 at twice of it (Politis and Romano 1995); or falling from the start.

    Of the two only the latter makes no variance negative: it has to end at 0 (Bartlett 1950).
    """
    lags = np.arange(min(2 * reach + 1, most))
    if tapered:
        return 1.0 - lags / len(lags)
    return np.clip(2.0 - lags / max(reach, 1), 0.0, 1.0)


def _long_run(gamma: Floats, reach: int) -> float:
    """Sum of the autocovariance from -inf to inf."""
    weights = _weights(reach, len(gamma))
    return float(gamma[0] + 2 * weights[1:] @ gamma[1 : len(weights)])


def _pair_sum(slopes: Floats, gamma: Floats, reach: int, tapered: bool = False) -> Floats:
    if not slopes.shape[1]:
        return np.zeros((0, 0))  # nothing is free: the fit is an evaluation
    weights = _weights(reach, len(gamma), tapered)
    kernel = weights * gamma[: len(weights)]
    middle = kernel[0] * (slopes.T @ slopes)
    if len(kernel) <= _FEW:
        for lag in range(1, len(kernel)):
            across = slopes[lag:].T @ slopes[:-lag]
            middle += kernel[lag] * (across + across.T)
        return np.asarray(middle)
    length = _smooth_length(len(slopes) + len(kernel))
    both = np.zeros(length)
    both[: len(kernel)] = kernel
    both[length - len(kernel) + 1 :] = kernel[:0:-1]
    share = np.fft.rfft(both).real / length
    share[1 : (length + 1) // 2] *= 2.0  # what stands for both signs of a frequency
    spectra = np.fft.rfft(slopes, length, axis=0)
    return np.asarray((spectra.conj().T @ (share[:, None] * spectra)).real)


@cache
def _smooth_length(least: int) -> int:
    """Return the least 2^a 3^b 5^c from `least` on, over which a Fourier transform is fast."""
    best = 1 << max(least - 1, 1).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            best = min(best, three << max(-(-least // three) - 1, 0).bit_length())
            three *= 3
        five *= 5
    return best


def mean_uncertainty(values: Floats) -> float:
    """Standard uncertainty of the mean of correlated values (n,), as values."""
    centred = values - values.mean()
    gamma, reach = _autocovariance(centred, 1)
    return float(np.sqrt(max(_long_run(gamma, reach), gamma[0] * 0.05) / len(values)))
