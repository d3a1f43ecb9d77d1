"""Standard uncertainty of a fit from its residuals as they are: correlated from sample to sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, lru_cache

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_kit.numerics.tip_travel import third_differences

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual

_BLOCK_SAMPLES = 1024  # within which neighbours are compared (choice)
_BLOCKS_AT_ONCE = 8  # evaluated in one call (choice: memory)
_MAX_SUMMED_LAGS = 40  # up to which sums are faster than Fourier transforms (measured)
_MAX_ROWS = 200_000  # that the correlation sums run over (choice: time); longer records are added up in pieces before
_MAX_TAKEN_SHARE = 0.6  # of the sum of the autocorrelation, taken by the fit, that is made good (choice)
_WINDOW_TIMES = 5.0  # correlation times up to which the correlation is summed (Sokal 1997)
_LAG_DIVISOR = 4  # a quarter of the values is the longest lag (choice)
_MIN_CORRELATION_TIME = 0.05  # [pieces] of residuals that alternate (choice)
_THIRD_DIFFERENCE_GAIN = 20.0  # 1 + 9 + 9 + 1: variance of third differences over that of white noise


@dataclass(frozen=True)
class ResidualScatter:
    """Size and correlation of the residuals at the minimum, and the covariance by them."""

    covariance: Floats  # (p, p) of the free unknowns
    inverse_normal: Floats  # (p, p) (J^T J)^-1
    samples: int
    effective_samples: float  # independent samples that the correlated ones are worth
    correlation_time: float  # [samples] sum of the autocorrelation from -inf to inf
    first_correlation: float  # autocorrelation of neighbours
    rss: float  # [N^2] plain sum of squares
    noise: float  # [N] standard deviation of white noise that would give the residual's third differences


def scatter(residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> ResidualScatter:
    """Return the sandwich covariance A^-1 S A^-1 of the free unknowns, with the statistics of the residuals.

    A = sum psi' J J^T, S = sum over pairs of gamma(i - j) J_i J_j^T; psi is the slope of the loss by the residual, psi'
    that of psi. gamma is the autocovariance of the residuals, summed as far as it reaches; the white-noise formula is
    the case that gamma vanishes between samples.
    """
    pieces = _sum_pieces(residual, record, x, loss)
    gamma, reach = _autocovariance(pieces.errors, len(residual.free))
    inverse = scaled_inverse(pieces.normal)
    middle = _pair_sum(pieces.slopes, gamma, reach)  # S
    covariance = inverse @ middle @ inverse
    # A window that ends flat can make a variance negative; one that falls from the start cannot.
    if (middle.diagonal() < 0).any() or (covariance.diagonal() < 0).any():
        covariance = inverse @ _pair_sum(pieces.slopes, gamma, reach, tapered=True) @ inverse
    # The correlation time [samples], by the sum of the autocorrelation of the pieces.
    time = 1.0
    if gamma[0] > 0:
        time = max(_long_run(gamma, reach) / gamma[0], _MIN_CORRELATION_TIME) * pieces.size
    effective = min(pieces.samples / time, float(pieces.samples))
    return ResidualScatter(
        covariance=covariance,
        inverse_normal=inverse,
        samples=pieces.samples,
        effective_samples=effective,
        correlation_time=time,
        first_correlation=pieces.first_correlation,
        rss=pieces.rss,
        noise=pieces.noise,
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


def _sum_pieces(residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> _Pieces:
    """Return residuals and slopes at unknowns x, summed over pieces, of which a record has at most 200 000.

    In the same pass over the record: A = sum psi' J J^T, the sum of squares, the products of neighbours, and the
    squares of third differences.
    """
    p = len(residual.free)
    # Pieces of equally many samples, the quotient rounded up.
    sums, piece_sums = _ErrorSums(), _PieceSums(size=-(-len(record) // _MAX_ROWS), remainder=np.zeros((0, 1 + p)))
    normal = np.zeros((p, p))
    is_whole = bool(record.used.all())
    block_samples = _BLOCK_SAMPLES * _BLOCKS_AT_ONCE if is_whole else _BLOCK_SAMPLES
    for rows, block in residual.blocks(record, x, block_samples):
        # Columns of the samples in use: the residual r, then the slopes J.
        values = block if is_whole else block[record.used[rows]]
        error, jacobian = values[:, 0], values[:, 1:]
        influence, curvature = loss.influence(error)  # psi, psi'
        normal += jacobian.T @ (jacobian if loss.kind == "linear" else jacobian * curvature[:, None])
        sums.add(error)
        piece_sums.add(np.column_stack([influence, jacobian]))
    return _Pieces(
        errors=np.concatenate(piece_sums.errors),
        slopes=np.concatenate(piece_sums.slopes),
        normal=normal,
        size=piece_sums.size,
        samples=sums.samples,
        rss=sums.rss,
        first_correlation=sums.first_correlation,
        noise=sums.noise,
    )


@dataclass
class _ErrorSums:
    """Sums over the residuals of a record, block by block."""

    samples: int = 0
    rss: float = 0.0  # [N^2]
    neighbour_products: float = 0.0  # [N^2]
    third_squares: float = 0.0  # [N^2] of third differences
    third_count: int = 0

    def add(self, error: Floats) -> None:
        """Add the residuals (n,) [N] of a block."""
        self.samples += len(error)
        self.rss += float(error @ error)
        for stretch in _stretches(error):
            self.neighbour_products += float(np.sum(stretch[:, 1:] * stretch[:, :-1]))
            differences = third_differences(stretch)
            self.third_squares += float(np.sum(differences * differences))
            self.third_count += differences.size

    @property
    def first_correlation(self) -> float:
        """Autocorrelation of neighbours."""
        return self.neighbour_products / self.rss if self.rss > 0 else 0.0

    @property
    def noise(self) -> float:
        """Standard deviation [N] of white noise with these third differences."""
        return float(np.sqrt(self.third_squares / (_THIRD_DIFFERENCE_GAIN * max(self.third_count, 1))))


@dataclass
class _PieceSums:
    """Sums of psi and means of the slopes over pieces of some samples each."""

    size: int  # [samples] of a piece
    remainder: Floats  # (k, 1 + p) samples of an unfinished piece, which wait for the next block
    errors: list[Floats] = field(default_factory=list)
    slopes: list[Floats] = field(default_factory=list)

    def add(self, influence_and_slopes: Floats) -> None:
        """Add psi and the slopes (n, 1 + p) of the samples of a block."""
        if self.size == 1:
            self.errors.append(influence_and_slopes[:, 0])
            self.slopes.append(influence_and_slopes[:, 1:])
            return
        waiting = np.concatenate([self.remainder, influence_and_slopes])
        whole = len(waiting) // self.size * self.size
        pieces = waiting[:whole].reshape(-1, self.size, waiting.shape[1])
        self.errors.append(pieces[:, :, 0].sum(axis=1))
        self.slopes.append(pieces[:, :, 1:].mean(axis=1))
        self.remainder = waiting[whole:]


def _stretches(values: Floats) -> Iterator[Floats]:
    """Yield values (n,) as stretches (m, 1024) of neighbours, then the shorter last one (1, n mod 1024)."""
    whole = len(values) // _BLOCK_SAMPLES * _BLOCK_SAMPLES
    if whole:
        yield values[:whole].reshape(-1, _BLOCK_SAMPLES)
    if whole < len(values):
        yield values[None, whole:]


def _autocovariance(errors: Floats, fitted: int) -> tuple[Floats, int]:
    """Return the autocovariance (m // 4 + 1,) of residuals (m,), and its reach.

    The reach is the shortest lag k >= 5 tau(k), tau(k) = 1 + 2 sum_(i <= k) rho_i the correlation time up to there
    (Sokal's window). A fit takes from its residuals what it can follow: with p `fitted` parameters each lag is too
    small by p/m of the sum over all lags. That sum over the window is then too small by a factor 1 - p K/m, K the
    window's area, which is made good.
    """
    m = len(errors)
    # Of residuals with as many zeros behind them, so that the circular correlation is the plain one.
    length = _smooth_length(2 * m)
    spectrum = np.fft.rfft(errors, length)
    gamma: Floats = np.fft.irfft(np.abs(spectrum) ** 2, length)[: max(m // _LAG_DIVISOR, 1) + 1] / m
    if gamma[0] <= 0:
        return gamma, 0
    times = 1.0 + 2.0 * np.cumsum(gamma[1:]) / gamma[0]
    long_lags = np.flatnonzero(np.arange(1, len(gamma)) >= _WINDOW_TIMES * times)
    reach = int(long_lags[0]) + 1 if len(long_lags) else len(gamma) - 1
    # What the fit has taken.
    area = 2.0 * float(_weights(reach, len(gamma)).sum()) - 1.0
    taken_share = min(fitted * area / m, _MAX_TAKEN_SHARE)
    correction = fitted / m * max(_long_run(gamma, reach), 0.0) / (1.0 - taken_share)
    return gamma + correction, reach


@lru_cache(256)
def _weights(reach: int, count: int, tapered: bool = False) -> Floats:
    """Return the weights of at most `count` lags: flat up to the reach, then falling to 0 at twice of it.

    Or `tapered`, falling from the start to 0. Of the two only the latter makes no variance negative.
    Sources: Politis and Romano 1995; Bartlett 1950.
    """
    lags = np.arange(min(2 * reach + 1, count))
    if tapered:
        return 1.0 - lags / len(lags)
    return np.clip(2.0 - lags / max(reach, 1), 0.0, 1.0)


def _long_run(gamma: Floats, reach: int) -> float:
    """Return the sum of the autocovariance from -inf to inf, by the window."""
    weights = _weights(reach, len(gamma))
    return float(gamma[0] + 2 * weights[1:] @ gamma[1 : len(weights)])


def _pair_sum(slopes: Floats, gamma: Floats, reach: int, tapered: bool = False) -> Floats:
    """Return S (p, p) = sum over pairs of w(i - j) gamma(i - j) J_i J_j^T, with slopes J (m, p) and the window w.

    For a long window by the spectra of the slopes, of which that of w gamma takes the products (Parseval).
    """
    if not slopes.shape[1]:
        return np.zeros((0, 0))  # nothing is free: the fit is an evaluation
    weights = _weights(reach, len(gamma), tapered)
    kernel = weights * gamma[: len(weights)]
    if len(kernel) <= _MAX_SUMMED_LAGS:
        pair_sum = kernel[0] * (slopes.T @ slopes)
        for lag in range(1, len(kernel)):
            products = slopes[lag:].T @ slopes[:-lag]
            pair_sum += kernel[lag] * (products + products.T)
        return np.asarray(pair_sum)
    length = _smooth_length(len(slopes) + len(kernel))
    two_sided = np.zeros(length)
    two_sided[: len(kernel)] = kernel
    two_sided[length - len(kernel) + 1 :] = kernel[:0:-1]
    power = np.fft.rfft(two_sided).real / length
    power[1 : (length + 1) // 2] *= 2.0  # of both signs of a frequency
    spectra = np.fft.rfft(slopes, length, axis=0)
    return np.asarray((spectra.conj().T @ (power[:, None] * spectra)).real)


@cache
def _smooth_length(min_length: int) -> int:
    """Return the least 2^a 3^b 5^c from `min_length` on, over which a Fourier transform is fast."""
    length = 1 << max(min_length - 1, 1).bit_length()
    five = 1
    while five < length:
        three = five
        while three < length:
            length = min(length, three << max(-(-min_length // three) - 1, 0).bit_length())
            three *= 3
        five *= 5
    return length


def mean_uncertainty(values: Floats) -> float:
    """Return the standard uncertainty of the mean of correlated values (n,), in their unit."""
    centred = values - values.mean()
    gamma, reach = _autocovariance(centred, 1)
    return float(np.sqrt(max(_long_run(gamma, reach), gamma[0] * _MIN_CORRELATION_TIME) / len(values)))
