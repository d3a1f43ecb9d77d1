"""The spectrum of times and the height of the skin that a press is best described by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats

from palpate_spectra.complex_moduli import poisson_of
from palpate_spectra.recorded_oscillation import beyond
from palpate_spectra.transient.hereditary_integrals import Bins, fading_integrals, logarithmic
from palpate_spectra.transient.recorded_press import RecordedPress
from palpate_spectra.transient.regularisation import Weighing, least, solve_regularised

_PER_DECADE = 8  # times of the spectrum
_BINS = 12  # of a decade of a hold
_RAMP_BINS = 20
_AVERAGED = 0.1  # [s]
_SHORTEST, _LONGEST = 0.02, 3.0  # times of the spectrum: shares of the first ramp and of the press
_REACH = 5e-4  # [m] around the place of the touch in which the skin is looked for
_UNRELATED = 0.05  # autocorrelation of residuals that have nothing to do with each other
_PIECES = 10  # of the longest hold, in which noise is what is left of a straight line
_EXACT = 1e-5  # of the largest target: no reading is better
_FOUND = 1e-6  # [m] to which it is found
_QUANTILE = 1.96  # of 95 %


@dataclass(frozen=True)
class PressUnknowns:
    """What is not known of a press before it is solved."""

    surface: float  # [m]
    compliance: float  # [m/N]
    offset: float = 0.0  # [N] of the force


@dataclass(frozen=True)
class SpectrumFit:
    """A spectrum for one surface and rig, and what it was fitted to."""

    times: Floats  # (k,) [s]
    weighing: Weighing
    columns: Floats  # (n, free + k)
    target: Floats  # (n,)
    free: int  # numbers before the spectrum's

    @property
    def fitted(self) -> Floats:
        """(n,) the target as the law has it."""
        return np.asarray(self.columns @ self.weighing.values)


@dataclass(frozen=True)
class PressProblem:
    """A press as a linear problem.

    Relaxation: F (1 - nu^2)/2 = int E(t - s) dA(s), E(t) = E + sum of E_k exp(-t/tau_k). Creep:
    A = int J(t - s) dF(s) (1 - nu^2)/2, J(t) = J + t/n + sum of J_k (1 - exp(-t/tau_k)). Both while the contact grows
    or stays (Lee and Radok 1960).
    """

    pressed: RecordedPress
    creeps: bool

    @cached_property
    def width(self) -> int:
        """Samples over which load and area are averaged before they are compared.

        What drives a creep is the measured force, whose noise would lower J (errors in variables). An average of both
        sides leaves the hereditary integral what it is.
        """
        return max(round(_AVERAGED / float(np.median(np.diff(self.pressed.time)))), 1) if self.creeps else 1

    def averaged(self, values: Floats) -> Floats:
        """Values (n,) with each the mean of those around it."""
        before = self.width // 2
        padded = np.pad(values, (before, self.width - 1 - before), "edge")
        sums = np.cumsum(np.concatenate([[0.0], padded]))
        return np.asarray((sums[self.width :] - sums[: -self.width]) / self.width)

    @cached_property
    def times(self) -> Floats:
        """Times (k,) [s] of the spectrum: from a fiftieth of the first ramp, or two samples, to three presses."""
        time, hold = self.pressed.time, self.pressed.holds[0]
        touch = float(time[np.argmax(self.pressed.height < self.pressed.touch)])
        low = max(_SHORTEST * (float(time[hold.begin]) - touch), 2.0 * float(np.median(np.diff(time))))
        high = _LONGEST * (float(time[-1]) - touch)
        return np.geomspace(low, high, max(round(_PER_DECADE * math.log10(high / low)) + 1, 4))

    @cached_property
    def bins(self) -> Bins:
        """Ramps in twenty pieces each, holds in twelve a decade of the time since their begin."""
        begins, counts, at = list[int](), list[int](), 0
        for hold in self.pressed.holds:
            pieces = np.array_split(np.arange(at, hold.begin), min(_RAMP_BINS, max(hold.begin - at, 1)))
            begins += [int(piece[0]) for piece in pieces if len(piece)]
            counts += [len(piece) for piece in pieces if len(piece)]
            held = logarithmic(self.pressed.time, hold.begin, hold.end, self.origin(hold.begin, at), _BINS, self.width)
            begins += held.begins.tolist()
            counts += held.counts.tolist()
            at = hold.end
        return Bins(np.array(begins), np.array(counts))

    def origin(self, row: int, since: int) -> float:
        """Return the middle [s] of a ramp that ends at a row and began after another."""
        down = np.flatnonzero(self.pressed.height[since:row] < self.pressed.touch)
        begin = since + (int(down[0]) if len(down) else 0)
        return 0.5 * float(self.pressed.time[begin] + self.pressed.time[row])

    def linear(self, rig: PressUnknowns) -> tuple[Floats, Floats, int]:
        """Columns (n, free + k) whose sum with the law's numbers is the target (n,), and how many no spectrum has."""
        pressed = self.pressed
        nu, time = poisson_of(pressed.model), pressed.time
        load = 0.5 * (1.0 - nu**2) * np.where(pressed.depth(rig.surface, 0.0) > 0, pressed.force + rig.offset, 0.0)
        area = pressed.area(rig.surface, rig.compliance)
        if self.creeps:
            load, area = self.averaged(load), self.averaged(area)
            flown = np.concatenate([[0.0], np.cumsum(0.5 * (load[1:] + load[:-1]) * np.diff(time))])
            return np.column_stack([load, flown, load[:, None] - fading_integrals(load, time, self.times)]), area, 2
        return np.column_stack([area, fading_integrals(area, time, self.times)]), load, 1

    def solve(self, rig: PressUnknowns, std: Floats, smoothing: float | None = None) -> SpectrumFit:
        """Return the spectrum, where the target's bins have the standard deviations (m,)."""
        columns, target, free = self.linear(rig)
        found = solve_regularised(self.bins.means(columns), self.bins.means(target), std, free, smoothing)
        return SpectrumFit(self.times, found, columns, target, free)

    def misfit(self, rig: PressUnknowns, std: Floats) -> float:
        """What the best of all spectra, smooth or not, leaves: chi^2."""
        columns, target, _ = self.linear(rig)
        return least(self.bins.means(columns), self.bins.means(target), std)

    def noise_of(self, values: Floats) -> float:
        """Standard deviation of white noise that would give a target's second differences."""
        noise = float(np.std(np.diff(values[self.pressed.holds[0].rows], 2)) / math.sqrt(6.0))
        return max(noise, _EXACT * float(np.abs(values).max()))

    def level(self, std: Floats) -> float:
        """Standard deviation of one reading of the target, as far as it matters to means, by that of the bins (m,)."""
        return float(np.median(std * np.sqrt(self.bins.counts)))

    def bins_std(self, solved: SpectrumFit) -> Floats:
        """Standard deviations (m,) of the bins' means, by what is left in the longest hold and its autocorrelation."""
        hold = max(self.pressed.holds, key=lambda one: one.end - one.begin)
        left = (solved.target - solved.fitted)[hold.rows]
        n = len(left)
        pieces = min(_PIECES, max(n // _PIECES, 1))
        for piece in np.array_split(np.arange(n), pieces):  # what is slower is misfit, and no noise
            line = np.polynomial.Polynomial.fit(piece, left[piece], 1)
            left[piece] -= line(piece)
        power = np.fft.rfft(left, 2 * n)
        correlation = np.fft.irfft(np.abs(power) ** 2)[: n // 4]
        variance = float(correlation[0]) / max(n - 2 * pieces, 1)
        shares = correlation / max(float(correlation[0]), 1e-300)
        ends = np.flatnonzero(shares < _UNRELATED)
        related = shares[1 : int(ends[0]) if len(ends) else len(shares)]
        counts = self.bins.counts
        exact = (_EXACT * float(np.abs(solved.target).max())) ** 2
        return np.asarray(
            np.sqrt(np.maximum(variance * np.minimum((1.0 + 2.0 * related.sum()) / counts, 1.0), exact / counts))
        )


def solve_spectrum(problem: PressProblem, surface: float | None) -> tuple[SpectrumFit, PressUnknowns, float, Floats]:
    """Return the spectrum, rig, standard uncertainty of the surface [m], and standard deviations of the bins."""
    pressed = problem.pressed
    compliance = float(pressed.rig["compliance"])
    rig = PressUnknowns(pressed.touch if surface is None else surface, compliance)
    target = problem.linear(rig)[1]
    std = np.full(len(problem.bins.counts), problem.noise_of(target)) / np.sqrt(problem.bins.counts)
    spread = 0.0
    for _ in range(2):  # the second time with the noise that the residuals of the first show
        if surface is None:
            place, spread = _skin(problem, rig, std)
            rig = PressUnknowns(place, compliance)
        std = problem.bins_std(problem.solve(rig, std))
    best = problem.solve(rig, std)
    if surface is None:
        hasty = (pressed.rig["timing"] or 0.0) * float(np.max(np.abs(np.gradient(pressed.height, pressed.time))))
        spread *= math.sqrt(max(best.weighing.chi2 / best.weighing.freedom, 1.0))
        spread = math.hypot(spread, hasty, beyond(pressed.seen, rig.surface))
    return best, rig, spread, std


def creep_spectrum(
    pressed: RecordedPress, level: float, rig: PressUnknowns
) -> tuple[PressProblem, SpectrumFit, Floats]:
    """A press as a creep, its spectrum, and standard deviations of its bins, for a load whose readings have a level.

    The noise is the force's, and moves the area by the same share of itself.
    """
    problem = PressProblem(pressed, creeps=True)
    hold = max(pressed.holds, key=lambda one: one.end - one.begin)
    columns, target, _ = problem.linear(rig)
    level *= float(target[hold.rows].mean() / columns[hold.rows, 0].mean())
    std = np.maximum(level, problem.noise_of(target)) / np.sqrt(problem.bins.counts)
    return problem, problem.solve(rig, std), std


def _skin(problem: PressProblem, rig: PressUnknowns, std: Floats) -> tuple[float, float]:
    """Return the middle [m] of all surfaces with which some spectrum describes the press, and their standard deviation.

    Which ones do is decided by chi^2 alone, at 95 %: a smooth spectrum has fast parts that a material need not have,
    and places the skin lower, or higher, to fit them.
    """
    from scipy.optimize import brentq, minimize_scalar

    def cost(place: float) -> float:
        return problem.misfit(PressUnknowns(place, rig.compliance), std)

    solve: Any = brentq  # its annotations want numpy's floats
    ends = (rig.surface - _REACH, rig.surface + _REACH)
    found: Any = minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": _FOUND})
    best, limit = float(found.x), float(found.fun) + _QUANTILE**2
    low, high = (
        float(solve(lambda place: cost(place) - limit, best, end, xtol=_FOUND)) if cost(end) > limit else end
        for end in ends
    )
    return 0.5 * (low + high), 0.5 * (high - low) / _QUANTILE
