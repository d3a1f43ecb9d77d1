"""Relaxation modulus E(t) or creep compliance J(t) at times after the ramp, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats
from palpate_kit.budget.force_sensitivity import with_change
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_spectra.complex_moduli import area, poisson_of
from palpate_spectra.transient.conversion import relaxation_of_creep
from palpate_spectra.transient.hereditary_integrals import Bins, logarithmic
from palpate_spectra.transient.recorded_press import RecordedPress
from palpate_spectra.transient.regularisation import Weighing
from palpate_spectra.transient.spectrum_fit import (
    PressProblem,
    PressUnknowns,
    SpectrumFit,
    creep_spectrum,
    solve_spectrum,
)

_PER_DECADE = 8  # points
_STEP = 1e-3  # of a number, for derivatives by differences


@dataclass(frozen=True)
class ModulusCurve:
    """E(t) [Pa] from a held depth, or J(t) [1/Pa] from a held force."""

    pressed: RecordedPress
    problem: PressProblem
    solved: SpectrumFit
    tested: Weighing  # of the force by the depth's history, whichever of both is held: the residual tests the law
    rig: PressUnknowns
    surface_std: float  # [m]
    time: Floats  # (m,) [s] since the middle of the change of depth, or of force
    value: Floats  # (m,)
    noise: Floats  # (m,) standard uncertainty by the noise, and by what the correction for the ramp does not know
    shifts: Mapping[str, Floats]  # (m,) by one standard uncertainty of each source
    correction: Floats  # (m,) the value over that of a sudden step to the same force, or depth

    @property
    def creeps(self) -> bool:
        """True if it is J(t)."""
        return self.problem.creeps

    @property
    def std(self) -> Floats:
        """Standard uncertainty (m,), all sources together."""
        return np.asarray(np.sqrt(self.noise**2 + sum((shift**2 for shift in self.shifts.values()), np.zeros(1))))

    @property
    def modulus(self) -> tuple[Floats, Floats]:
        """E (m,) [Pa] at the curve's times, and its standard uncertainty: itself, or of a creep by its spectrum.

        The relative uncertainty of a converted E is that of J, whose inverse it nearly is.
        """
        if not self.creeps:
            return self.value, self.std
        found = self.solved.weighing.values
        value = relaxation_of_creep(float(found[0]), float(found[1]), found[2:], self.solved.times, self.time)
        return value, value * self.std / self.value

    def fitted(self, time: Floats) -> tuple[Floats, Floats]:
        """Return the curve of the spectrum at times (m,) [s], and its standard uncertainty by noise and smoothing."""
        rows = _rows(self.solved, time)
        values = rows @ self.solved.weighing.values
        return values, np.sqrt(np.sum((rows @ self.solved.weighing.covariance) * rows, axis=1))


def curve(pressed: RecordedPress, surface: float | None = None) -> ModulusCurve:
    """E(t) or J(t), of the longest hold, by the tip's whole way and not by a step that it was not.

    A point is the record's value at an instant T over that of the fitted law there, times the fitted law at
    t = T - s, s the centre of the changes until then: a ratio in which the law is only the small correction for the
    ramp's duration, since the time from the centre is right to first order (Zapas and Phillips 1971).
    """
    problem = PressProblem(pressed, creeps=False)
    best, rig, surface_std, std = solve_spectrum(problem, surface)
    tested = best.weighing
    if pressed.holds[0].kind == "creep":
        problem, best, std = creep_spectrum(pressed, problem.level(std), rig)
    time, value, gradient, correction, spread = _points(problem, best, std, bins := _bins(problem, best))
    noise = np.sqrt(np.sum((gradient @ best.weighing.covariance) * gradient, axis=1) + spread**2)
    found = ModulusCurve(pressed, problem, best, tested, rig, surface_std, time, value, noise, {}, correction)
    return replace(found, shifts=_shifts(found, std, bins))


def _rows(solved: SpectrumFit, time: Floats) -> Floats:
    """Rows (m, free + k) that give the curve at times (m,) [s]."""
    left = np.exp(-np.outer(time, 1.0 / solved.times))
    if solved.free == 1:
        return np.column_stack([np.ones(len(time)), left])
    return np.column_stack([np.ones(len(time)), time, 1.0 - left])


def _since(problem: PressProblem, found: SpectrumFit) -> Floats:
    """Return the centre (n,) [s] of the changes until each instant."""
    driven = found.columns[:, 0]  # the area, or the load
    return np.asarray(
        np.cumsum(np.diff(driven, prepend=0.0) * problem.pressed.time) / np.where(driven > 0, driven, 1.0)
    )


def _bins(problem: PressProblem, found: SpectrumFit) -> Bins:
    """Return the rows of each point, in the longest hold."""
    hold = max(problem.pressed.holds, key=lambda one: one.end - one.begin)
    centre = float(_since(problem, found)[hold.begin])
    return logarithmic(problem.pressed.time, hold.begin, hold.end, centre, _PER_DECADE, problem.width)


def _points(
    problem: PressProblem, best: SpectrumFit, std: Floats, bins: Bins
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Times, values, their gradients by the law's numbers, corrections, and standard deviations by the bins' noise."""
    pressed, since, driven = problem.pressed, _since(problem, best), best.columns[:, 0]
    lag = bins.means(pressed.time - since)
    rows, fitted_rows = _rows(best, lag), bins.means(best.columns)
    law, fitted, seen = rows @ best.weighing.values, bins.means(best.fitted), bins.means(best.target)
    value = law * seen / fitted
    gradient = value[:, None] * (rows / law[:, None] - fitted_rows / fitted[:, None])
    spread = value * np.minimum(problem.level(std) / np.sqrt(bins.counts), float(std.max())) / fitted
    return lag, value, gradient, value / (seen / bins.means(driven)), spread


def _shifts(curve: ModulusCurve, std: Floats, bins: Bins) -> dict[str, Floats]:
    """Shifts (m,) of the values by one standard uncertainty of each source that is the same for all of them."""
    problem, rig, pressed = curve.problem, curve.rig, curve.pressed
    weight = curve.solved.weighing.smoothing

    def by(other: PressUnknowns) -> Floats:
        return np.asarray(_points(problem, problem.solve(other, std, weight), std, bins)[1] - curve.value)

    found = {"offset": by(replace(rig, offset=pressed.offset_std))}
    if curve.surface_std:
        found["surface"] = by(replace(rig, surface=rig.surface + curve.surface_std))
    if give := float(pressed.rig["compliance_std"]):
        found["compliance"] = by(replace(rig, compliance=rig.compliance + give))
    if timing := pressed.rig["timing"]:
        found["timing"] = np.gradient(curve.value, curve.time) * timing if len(curve.time) > 1 else 0 * curve.value
    sign = -1.0 if curve.creeps else 1.0
    found |= {name: sign * share * curve.value for name, share in _scales(curve).items()}
    return {name: shift for name, shift in found.items() if np.any(shift)}


def _scales(curve: ModulusCurve) -> dict[str, float]:
    """Relative changes of E by what is declared of tip, layer and readings, or has a default."""
    pressed, nu = curve.pressed, poisson_of(curve.pressed.model)
    depth = pressed.depth(curve.rig.surface, curve.rig.compliance)[[pressed.holds[-1].end - 1]]
    here = float(area(pressed.model, depth)[0])
    found = {}
    for source in sources_of(pressed.model, pressed.uncertainties):
        if source.path == ("poisson",):
            found[source.name] = 2.0 * nu * source.std / (1.0 - nu**2)
        elif source.path:
            step = _STEP * (abs(source.value) or 1.0)
            there = float(area(with_change(pressed.model, source.path, step), depth)[0])
            found[source.name] = (here / there - 1.0) / step * source.std
        elif source.name == "force_scale":
            found[source.name] = source.std
        else:
            there = float(area(pressed.model, depth * (1.0 + _STEP))[0])
            found[source.name] = (here / there - 1.0) / _STEP * source.std
    return {name: share for name, share in found.items() if math.isfinite(share)}
