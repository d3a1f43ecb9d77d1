"""A press as a linear problem for the spectrum of times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate import Floats

from palpate_spectra.reduced_area import poisson_of
from palpate_spectra.transient.hereditary_integrals import Bins, fading_integrals, logarithmic_bins
from palpate_spectra.transient.recorded_press import RecordedPress
from palpate_spectra.transient.regularisation import SpectrumEstimate, min_chi2, solve_regularised

# Choices, as docs/relaxation.md states those that a user meets.
_TIMES_PER_DECADE = 8  # of the spectrum
_MIN_TIMES = 4  # of the spectrum
_SHORTEST_RAMP_SHARE = 0.02  # of the first ramp: the shortest time of the spectrum
_SHORTEST_INTERVALS = 2.0  # sampling intervals, below which the spectrum has no time
_LONGEST_PRESS_SHARE = 3.0  # of the press: the longest time of the spectrum
_HOLD_BINS_PER_DECADE = 12
_RAMP_BINS = 20
_AVERAGING_TIME = 0.1  # [s] of load and area of a creep
_MIN_AUTOCORRELATION = 0.05  # of residuals; the first lag below it ends the sum
_DETREND_PIECES = 10  # of the longest hold, in each of which a straight line is misfit, and no noise
_EXACT_SHARE = 1e-5  # of the largest target: no reading is more exact
_SECOND_DIFFERENCE_VARIANCE = 6.0  # of white noise of variance 1: 1 + 4 + 1
_MIN_VARIANCE = 1e-300  # keeps a division by a variance finite


@dataclass(frozen=True)
class PressUnknowns:
    """The numbers of skin and rig that a press is solved with."""

    surface: float  # [m]
    compliance: float  # [m/N]
    offset: float = 0.0  # [N] of the force


@dataclass(frozen=True)
class SpectrumFit:
    """A spectrum for one surface and rig, and the columns and target of its least squares."""

    times: Floats  # (k,) [s]
    estimate: SpectrumEstimate
    columns: Floats  # (n, free + k) the target by a coefficient of 1 each
    target: Floats  # (n,) load of a relaxation, area of a creep
    free: int  # coefficients before the spectrum's

    @property
    def fitted(self) -> Floats:
        """(n,) the target by the fitted law."""
        return np.asarray(self.columns @ self.estimate.values)


@dataclass(frozen=True)
class PressProblem:
    """A press as a linear problem.

    Relaxation: F (1 - nu^2)/2 = int E(t - s) dA(s), E(t) = E + sum of E_k exp(-t/tau_k). Creep:
    A = int J(t - s) dF(s) (1 - nu^2)/2, J(t) = J + t/n + sum of J_k (1 - exp(-t/tau_k)). Both while the contact grows
    or stays (Lee and Radok 1960).
    """

    press: RecordedPress
    creeps: bool

    @cached_property
    def averaged_samples(self) -> int:
        """Samples over which load and area are averaged before they are compared.

        A creep is driven by the measured force, whose noise would lower J (errors in variables). An average of both
        sides leaves the hereditary integral unchanged.
        """
        if not self.creeps:
            return 1
        interval = float(np.median(np.diff(self.press.time)))
        return max(round(_AVERAGING_TIME / interval), 1)

    def moving_average(self, values: Floats) -> Floats:
        """Return values (n,), each averaged over the samples around it; the ends are repeated beyond the record."""
        width = self.averaged_samples
        before = width // 2
        padded = np.pad(values, (before, width - 1 - before), "edge")
        sums = np.cumsum(np.concatenate([[0.0], padded]))
        return np.asarray((sums[width:] - sums[:-width]) / width)

    @cached_property
    def times(self) -> Floats:
        """Times (k,) [s] of the spectrum: from a fiftieth of the first ramp, or two samples, to three presses."""
        time, first_hold = self.press.time, self.press.holds[0]
        touch_time = float(time[np.argmax(self.press.height < self.press.touch)])
        ramp_duration = float(time[first_hold.begin]) - touch_time
        interval = float(np.median(np.diff(time)))
        shortest = max(_SHORTEST_RAMP_SHARE * ramp_duration, _SHORTEST_INTERVALS * interval)
        longest = _LONGEST_PRESS_SHARE * (float(time[-1]) - touch_time)
        count = max(round(_TIMES_PER_DECADE * math.log10(longest / shortest)) + 1, _MIN_TIMES)
        return np.geomspace(shortest, longest, count)

    @cached_property
    def bins(self) -> Bins:
        """Bins (m,) of the press: twenty of each ramp; of a hold twelve a decade of time since its ramp's middle."""
        begins, counts, ramp_begin = list[int](), list[int](), 0
        for hold in self.press.holds:
            ramp_bins = min(_RAMP_BINS, max(hold.begin - ramp_begin, 1))
            ramp_pieces = np.array_split(np.arange(ramp_begin, hold.begin), ramp_bins)
            begins += [int(piece[0]) for piece in ramp_pieces if len(piece)]
            counts += [len(piece) for piece in ramp_pieces if len(piece)]
            hold_bins = logarithmic_bins(
                self.press.time,
                hold.begin,
                hold.end,
                origin=self._ramp_middle(ramp_begin, hold.begin),
                per_decade=_HOLD_BINS_PER_DECADE,
                min_rows=self.averaged_samples,
            )
            begins += hold_bins.begins.tolist()
            counts += hold_bins.counts.tolist()
            ramp_begin = hold.end
        return Bins(np.array(begins), np.array(counts))

    def _ramp_middle(self, first: int, end: int) -> float:
        """Return the middle [s] of a ramp between two rows, without the air before the touch."""
        is_pressed = self.press.height[first:end] < self.press.touch
        pressed_rows = np.flatnonzero(is_pressed)
        begin = first + (int(pressed_rows[0]) if len(pressed_rows) else 0)
        return 0.5 * float(self.press.time[begin] + self.press.time[end])

    def linear_system(self, rig: PressUnknowns) -> tuple[Floats, Floats, int]:
        """Return columns (n, free + k), their target (n,), and `free`: columns @ the law's coefficients = target.

        The first `free` coefficients are not of the spectrum: E of a relaxation; J and 1/n of a creep, whose columns
        are the load F, its integral over time, and F - int exp(-(t - s)/tau_k) dF(s).
        """
        press, time = self.press, self.press.time
        nu = poisson_of(press.model)
        is_below_skin = press.depth(rig.surface, 0.0) > 0
        load = 0.5 * (1.0 - nu**2) * np.where(is_below_skin, press.force + rig.offset, 0.0)
        area = press.area(rig.surface, rig.compliance)
        if not self.creeps:
            return np.column_stack([area, fading_integrals(area, time, self.times)]), load, 1
        load, area = self.moving_average(load), self.moving_average(area)
        load_integral = np.concatenate([[0.0], np.cumsum(0.5 * (load[1:] + load[:-1]) * np.diff(time))])
        retarded_load = load[:, None] - fading_integrals(load, time, self.times)
        return np.column_stack([load, load_integral, retarded_load]), area, 2

    def solve(self, rig: PressUnknowns, std: Floats, smoothing: float | None = None) -> SpectrumFit:
        """Return the spectrum, where the target's means over the bins have standard deviations (m,)."""
        columns, target, free = self.linear_system(rig)
        estimate = solve_regularised(self.bins.means(columns), self.bins.means(target), std, free, smoothing)
        return SpectrumFit(self.times, estimate, columns, target, free)

    def min_chi2(self, rig: PressUnknowns, std: Floats) -> float:
        """Return the chi^2 that the best of all spectra, smooth or not, leaves."""
        columns, target, _ = self.linear_system(rig)
        return min_chi2(self.bins.means(columns), self.bins.means(target), std)

    def noise_std(self, target: Floats) -> float:
        """Return the standard deviation of white noise that would give the second differences of a target (n,)."""
        second_differences = np.diff(target[self.press.holds[0].rows], 2)
        noise = float(np.std(second_differences) / math.sqrt(_SECOND_DIFFERENCE_VARIANCE))
        return max(noise, _EXACT_SHARE * float(np.abs(target).max()))

    def sample_std(self, std: Floats) -> float:
        """Return the standard deviation of one reading of the target, by those of the bins' means (m,).

        It is that of white noise whose means scatter as much.
        """
        return float(np.median(std * np.sqrt(self.bins.counts)))

    def bin_stds(self, fit: SpectrumFit) -> Floats:
        """Return standard deviations (m,) of the bins' means, by the residual of the longest hold.

        Of c correlated readings the mean has the variance s^2 (1 + 2 sum of rho)/c, rho the autocorrelation of the
        residual up to the first lag at which it is below 0.05; and never more than s^2.
        """
        residual, lines = _detrend((fit.target - fit.fitted)[self.press.longest_hold.rows])
        n = len(residual)
        # Autocovariance by the power spectrum, padded so that the ends do not meet.
        power = np.abs(np.fft.rfft(residual, 2 * n)) ** 2
        autocovariance = np.fft.irfft(power)[: n // 4]
        variance = float(autocovariance[0]) / max(n - 2 * lines, 1)  # a line has two parameters
        autocorrelation = autocovariance / max(float(autocovariance[0]), _MIN_VARIANCE)
        uncorrelated_lags = np.flatnonzero(autocorrelation < _MIN_AUTOCORRELATION)
        last_lag = int(uncorrelated_lags[0]) if len(uncorrelated_lags) else len(autocorrelation)
        correlation_sum = autocorrelation[1:last_lag].sum()

        counts = self.bins.counts
        exact_variance = (_EXACT_SHARE * float(np.abs(fit.target).max())) ** 2
        mean_variance = variance * np.minimum((1.0 + 2.0 * correlation_sum) / counts, 1.0)
        return np.asarray(np.sqrt(np.maximum(mean_variance, exact_variance / counts)))


def _detrend(residual: Floats) -> tuple[Floats, int]:
    """Return a residual (n,) without a straight line in each of ten pieces, and the number of pieces."""
    residual = residual.copy()
    n = len(residual)
    count = min(_DETREND_PIECES, max(n // _DETREND_PIECES, 1))
    for piece in np.array_split(np.arange(n), count):
        line = np.polynomial.Polynomial.fit(piece, residual[piece], 1)
        residual[piece] -= line(piece)
    return residual, count
