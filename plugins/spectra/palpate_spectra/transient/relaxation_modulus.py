"""Relaxation modulus E(t) or creep compliance J(t) at times after the ramp, each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats
from palpate_kit.budget.force_sensitivity import with_change
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_spectra.complex_moduli import RELATIVE_STEP
from palpate_spectra.reduced_area import poisson_of, reduced_area
from palpate_spectra.transient.conversion import relaxation_of_creep
from palpate_spectra.transient.hereditary_integrals import Bins, logarithmic_bins
from palpate_spectra.transient.press_problem import PressProblem, PressUnknowns, SpectrumFit
from palpate_spectra.transient.recorded_press import RecordedPress
from palpate_spectra.transient.regularisation import SpectrumEstimate
from palpate_spectra.transient.spectrum_fit import creep_spectrum, solve_spectrum

_POINTS_PER_DECADE = 8  # of the curve: a choice


@dataclass(frozen=True)
class ModulusCurve:
    """E(t) [Pa] from a held depth, or J(t) [1/Pa] from a held force."""

    press: RecordedPress
    problem: PressProblem
    fit: SpectrumFit
    relaxation_fit: SpectrumEstimate  # of the force by the depth's history, even of a creep: its residual tests the law
    rig: PressUnknowns
    surface_std: float  # [m]
    time: Floats  # (m,) [s] since the middle of the change of depth, or of force
    value: Floats  # (m,)
    noise: Floats  # (m,) standard uncertainty by the noise, and by the fitted correction for the ramp
    shifts: Mapping[str, Floats]  # (m,) by one standard uncertainty of each source
    correction: Floats  # (m,) the value over that of a sudden step to the same force, or depth

    @property
    def creeps(self) -> bool:
        """True if it is J(t)."""
        return self.problem.creeps

    @property
    def std(self) -> Floats:
        """Standard uncertainty (m,), all sources together."""
        shift_variance = sum((shift**2 for shift in self.shifts.values()), np.zeros(1))
        return np.asarray(np.sqrt(self.noise**2 + shift_variance))

    @property
    def modulus(self) -> tuple[Floats, Floats]:
        """E (m,) [Pa] at the curve's times, and its standard uncertainty: itself, or of a creep by its spectrum.

        The relative uncertainty of a converted E is that of J, whose inverse it nearly is.
        """
        if not self.creeps:
            return self.value, self.std
        coefficients = self.fit.estimate.values
        instant, fluidity = float(coefficients[0]), float(coefficients[1])
        value = relaxation_of_creep(instant, fluidity, coefficients[2:], times=self.fit.times, instants=self.time)
        return value, value * self.std / self.value

    def fitted(self, time: Floats) -> tuple[Floats, Floats]:
        """Return the curve of the spectrum at times (m,) [s], and its standard uncertainty by noise and smoothing."""
        rows = _curve_rows(self.fit, time)
        return rows @ self.fit.estimate.values, np.sqrt(_linear_variance(rows, self.fit.estimate))


@dataclass(frozen=True)
class _CurvePoints:
    """The points of a curve (m,)."""

    time: Floats  # [s]
    value: Floats
    gradient: Floats  # (m, free + k) of the values by the law's coefficients
    correction: Floats
    sample_noise: Floats  # standard deviations of the values by the noise of the bins


def modulus_curve(press: RecordedPress, surface: float | None = None) -> ModulusCurve:
    """Return E(t) or J(t) of the longest hold, with the ramp as it was measured; the skin is at a stated `surface` [m].

    A point is the record's value at an instant T over that of the fitted law there, times the fitted law at
    t = T - s, s the centre of the changes until then: a ratio in which the law is only the small correction for the
    ramp's duration, since the time from the centre is right to first order (Zapas and Phillips 1971).
    """
    problem = PressProblem(press, creeps=False)
    fit, rig, surface_std, bin_stds = solve_spectrum(problem, surface)
    relaxation_fit = fit.estimate
    if press.holds[0].kind == "creep":
        problem, fit, bin_stds = creep_spectrum(press, problem.sample_std(bin_stds), rig)
    bins = _point_bins(problem, fit)
    points = _curve_points(problem, fit, bin_stds, bins)
    noise = np.sqrt(_linear_variance(points.gradient, fit.estimate) + points.sample_noise**2)
    curve = ModulusCurve(
        press=press,
        problem=problem,
        fit=fit,
        relaxation_fit=relaxation_fit,
        rig=rig,
        surface_std=surface_std,
        time=points.time,
        value=points.value,
        noise=noise,
        shifts={},
        correction=points.correction,
    )
    return replace(curve, shifts=_curve_shifts(curve, bin_stds, bins))


def _linear_variance(rows: Floats, estimate: SpectrumEstimate) -> Floats:
    """Return the variances (m,) of rows (m, free + k) @ the coefficients of an estimate."""
    return np.asarray(np.sum((rows @ estimate.covariance) * rows, axis=1))


def _curve_rows(fit: SpectrumFit, time: Floats) -> Floats:
    """Return the rows (m, free + k) whose product with the law's coefficients is the curve at times (m,) [s].

    1 and exp(-t/tau_k) of a relaxation; 1, t and 1 - exp(-t/tau_k) of a creep.
    """
    fading = np.exp(-np.outer(time, 1.0 / fit.times))
    if fit.free == 1:
        return np.column_stack([np.ones(len(time)), fading])
    return np.column_stack([np.ones(len(time)), time, 1.0 - fading])


def _change_centres(problem: PressProblem, fit: SpectrumFit) -> Floats:
    """Return the centre (n,) [s] of the changes of area, or of a creep of load, until each instant."""
    driving = fit.columns[:, 0]
    first_moment = np.cumsum(np.diff(driving, prepend=0.0) * problem.press.time)
    return np.asarray(first_moment / np.where(driving > 0, driving, 1.0))


def _point_bins(problem: PressProblem, fit: SpectrumFit) -> Bins:
    """Return the rows of each point of the curve, in the longest hold."""
    hold = problem.press.longest_hold
    return logarithmic_bins(
        problem.press.time,
        hold.begin,
        hold.end,
        origin=float(_change_centres(problem, fit)[hold.begin]),
        per_decade=_POINTS_PER_DECADE,
        min_rows=problem.averaged_samples,
    )


def _curve_points(problem: PressProblem, fit: SpectrumFit, bin_stds: Floats, bins: Bins) -> _CurvePoints:
    """Return the points of the bins: value = law(t) * measured target/fitted target, t since the centre of changes."""
    time = bins.means(problem.press.time - _change_centres(problem, fit))
    rows = _curve_rows(fit, time)
    law = rows @ fit.estimate.values
    fitted, measured = bins.means(fit.fitted), bins.means(fit.target)
    value = law * measured / fitted
    # Relative derivatives by a coefficient: those of the law less those of the fitted target.
    gradient = value[:, None] * (rows / law[:, None] - bins.means(fit.columns) / fitted[:, None])
    target_std = np.minimum(problem.sample_std(bin_stds) / np.sqrt(bins.counts), float(bin_stds.max()))
    step_value = measured / bins.means(fit.columns[:, 0])  # of a sudden step: the target over the driving area or load
    return _CurvePoints(time, value, gradient, correction=value / step_value, sample_noise=value * target_std / fitted)


def _curve_shifts(curve: ModulusCurve, bin_stds: Floats, bins: Bins) -> dict[str, Floats]:
    """Return the shifts (m,) of the values by one standard uncertainty of each source that all of them share."""
    problem, rig, press = curve.problem, curve.rig, curve.press
    smoothing = curve.fit.estimate.smoothing

    def shift_by(changed_rig: PressUnknowns) -> Floats:
        """Return the shift with another rig, solved at the same smoothing."""
        changed_fit = problem.solve(changed_rig, bin_stds, smoothing)
        return np.asarray(_curve_points(problem, changed_fit, bin_stds, bins).value - curve.value)

    shifts = {"offset": shift_by(replace(rig, offset=press.offset_std))}
    if curve.surface_std:
        shifts["surface"] = shift_by(replace(rig, surface=rig.surface + curve.surface_std))
    if compliance_std := float(press.rig["compliance_std"]):
        shifts["compliance"] = shift_by(replace(rig, compliance=rig.compliance + compliance_std))
    if timing_std := press.rig["timing"]:
        has_slope = len(curve.time) > 1
        slope = np.gradient(curve.value, curve.time) if has_slope else 0 * curve.value
        shifts["timing"] = slope * timing_std
    # What raises E lowers J by the same share.
    sign = -1.0 if curve.creeps else 1.0
    shifts |= {source: sign * share * curve.value for source, share in _relative_shifts(curve).items()}
    return {source: shift for source, shift in shifts.items() if np.any(shift)}


def _relative_shifts(curve: ModulusCurve) -> dict[str, float]:
    """Return the relative changes of E by one standard uncertainty of each number of tip, layer and readings.

    The uncertainties are declared, or have a default (`sources_of`). E goes with 1 - nu^2, with the force, and with the
    inverse of the area at the end of the last hold.
    """
    press = curve.press
    model, poisson = press.model, poisson_of(press.model)
    last_row = press.holds[-1].end - 1
    depth = press.depth(curve.rig.surface, curve.rig.compliance)[[last_row]]
    area = float(reduced_area(model, depth)[0])
    shares = {}
    for source in sources_of(model, press.uncertainties):
        if source.path == ("poisson",):
            # Towards a smaller ratio, as it cannot be above 0.5.
            shares[source.name] = 2.0 * poisson * source.std / (1.0 - poisson**2)
        elif source.path:
            step = RELATIVE_STEP * (abs(source.value) or 1.0)
            changed_area = float(reduced_area(with_change(model, source.path, step), depth)[0])
            shares[source.name] = (area / changed_area - 1.0) / step * source.std
        elif source.name == "force_scale":
            shares[source.name] = source.std
        else:  # the factor of the position
            changed_area = float(reduced_area(model, depth * (1.0 + RELATIVE_STEP))[0])
            shares[source.name] = (area / changed_area - 1.0) / RELATIVE_STEP * source.std
    return {name: share for name, share in shares.items() if math.isfinite(share)}
