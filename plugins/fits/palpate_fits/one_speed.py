"""Viscosities at one speed, which are the height of the surface to first order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import Floats, Parameter
from palpate_kit.numerics.normal_equations import scaled_inverse, symmetric_inverse

from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.loss import LossFunction
from palpate_fits.profile_likelihood import ProfileIntervals
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution, solve_lm
from palpate_fits.uncertainty import ResidualScatter
from palpate_fits.unknowns import Unknowns, at_physical_bounds

SIGMAS = 2.0  # standard uncertainties within which a value may be 0 (choice)
CURVED = 2.0  # ratio of uncertainties at 0 and at the estimate, from which on the latter is made by curvature (choice)
MIRRORED = 0.1  # of the size of a viscosity below none: one above it and smaller is at the bound, no minimum (choice)
SAMPLES = 4000  # whose slopes are taken (choice)
SINGULAR = 1e-12  # of the largest eigenvalue of scaled slopes (choice), below which a direction does not count
_SMALLEST = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class OneSpeedInterval:
    """Both ends of a viscosity that its own size alone determines; from none on, the record does not determine it."""

    lower: float  # [SI]
    upper: float  # [SI]
    covariance: Floats  # (p, p) of the free unknowns; two standard uncertainties reach to the farther end


def one_speed_intervals(fit: FitOutcome, scatter: ResidualScatter) -> Iterator[tuple[int, OneSpeedInterval]]:
    """Yield each viscosity that a record determines by its own size alone, by its place among the free.

    `scatter` has the residuals' size and the covariance of the free unknowns by them.
    F = E a(d) + eta b(d) d' with b proportional to the slope of a: at one speed eta d' b(d) is the force of a surface
    that is higher, and the two differ by the square of eta alone. Noise then looks like a viscosity, and the curvature
    of the misfit there understates its uncertainty. If the estimate is within two of the uncertainties that it would
    have at eta = 0, its interval is that of the likelihood profile at two standard uncertainties. Without air the
    interval begins at 0, since nothing bounds the surface from above.
    """
    parameters = fit.problem.model.parameters
    for j, place in enumerate(fit.residual.free):
        if place >= len(parameters) or not _is_viscous(parameters[place]) or fit.problem.model.memory:
            continue
        std_if_none, std_if_alone = _std_if_none(fit, scatter, j)
        is_curved = std_if_none > CURVED * float(np.sqrt(scatter.covariance[j, j]))
        if not is_curved or fit.solution.x[place] > SIGMAS * std_if_none:
            continue
        profile = ProfileIntervals(fit.residual, fit.unknowns, fit.record, fit.solution.x, fit.loss)
        if not profile.determines(place):
            continue
        yield j, _interval(fit, profile, scatter, j, std_if_alone)


def with_possible_viscosity(
    residual: Residual, unknowns: Unknowns, record: FitRecord, loss: LossFunction, solution: Solution
) -> tuple[Unknowns, Solution]:
    """Return the unknowns and the fit without a viscosity below 0 that only its own size determines.

    Both are unchanged if no fit within the physical bounds explains the record as well.

    A surface that is higher by s with a viscosity, and one that is lower by s without, differ in their force by s^3:
    least squares takes either. Of two that the record does not distinguish, only one is of a material.
    """
    free = list(residual.free)
    for j, place in enumerate(free):
        value = float(solution.x[place])
        if place >= len(residual.model.parameters) or value >= 0.0 or not _is_viscous(residual.model.parameters[place]):
            continue
        # Start at the mirrored value, the others as they fit best there.
        start = solution.x.copy()
        profile = ProfileIntervals(residual, unknowns, record, solution.x, loss)
        with np.errstate(all="ignore"):
            start[free] = profile.with_held(place, -value)
        if not np.isfinite(start).all():  # the force does not depend on the viscosity
            continue
        bounded = at_physical_bounds(unknowns, residual.model)
        possible = solve_lm(residual, bounded, record, start, loss)
        # Twice the rise of the cost is chi square in units of the variance of the residual.
        variance = 2.0 * solution.cost / max(int(np.count_nonzero(record.used)), 1)
        is_plausible = 2.0 * (possible.cost - solution.cost) <= SIGMAS**2 * variance
        if is_plausible and (
            possible.x[place] > MIRRORED * -value or _is_flatter(residual, record, solution, possible, j)
        ):
            return bounded, possible
    return unknowns, solution


def _is_flatter(residual: Residual, record: FitRecord, solution: Solution, possible: Solution, j: int) -> bool:
    """Return True if the variance of the j-th free unknown by the slopes at a possible solution is far larger."""
    variances = [scaled_inverse(residual.normal(record, fit.x)[1:, 1:])[j, j] for fit in (solution, possible)]
    return bool(variances[1] > CURVED**2 * variances[0])


def _is_viscous(parameter: Parameter) -> bool:
    """Return True if a material has none of a parameter or more, as of a viscosity."""
    return parameter.role == "viscous" and parameter.lower == 0.0


def _std_if_none(fit: FitOutcome, scatter: ResidualScatter, j: int) -> tuple[float, float]:
    """Return two standard uncertainties of the j-th free unknown by the slopes where it is 0: others free, and known.

    The share of its slope's square that no other unknown can follow makes the difference. Noise of the rate adds to
    that share by its own share in the mean square of the rate, which is subtracted.
    """
    record, x = fit.record.thinned(SAMPLES), fit.solution.x.copy()
    x[fit.residual.free[j]] = 0.0
    square = fit.residual.normal(record, x)[1:, 1:] * (len(fit.record) / max(len(record), 1))
    lengths = np.sqrt(square.diagonal())
    if not lengths[j] > 0:
        return np.inf, 1.0  # without a slope the search for an end begins with a step of 1 [SI]
    lengths[~(lengths > 0)] = 1.0
    scaled = square / (lengths[:, None] * lengths)
    other_unknowns = np.delete(np.arange(len(scaled)), j)
    followed_share = (
        scaled[j, other_unknowns]
        @ symmetric_inverse(scaled[np.ix_(other_unknowns, other_unknowns)], SINGULAR)
        @ scaled[other_unknowns, j]
    )
    rate = fit.record.rate[fit.record.used]
    noise = fit.motion.rate_noise**2 / max(float(np.mean(rate**2)), _SMALLEST)
    share, alone = 1.0 - float(followed_share) - noise, _spread(scatter) / float(lengths[j])
    return alone / np.sqrt(share) if share > 0 else np.inf, alone


def _spread(scatter: ResidualScatter) -> float:
    """Return the standard deviation [N] that independent residuals of the same weight would have."""
    return float(np.sqrt(scatter.rss / max(scatter.effective_samples, 1.0)))


def _interval(
    fit: FitOutcome, profile: ProfileIntervals, scatter: ResidualScatter, j: int, step: float
) -> OneSpeedInterval:
    """Return the interval of the j-th free unknown, searched from a first step, with the covariance of all.

    The covariance is that of the others if this one were known, plus the effect of this one on them.
    """
    place, estimate, spread = fit.residual.free[j], fit.solution.x[list(fit.residual.free)], _spread(scatter)
    value = float(estimate[j])
    upper = max(profile.upper_end(place, SIGMAS, step, spread) or 0.0, value)
    lower = 0.0 if fit.begins_in_contact() else profile.end_above(place, 0.0, SIGMAS, spread)
    # Covariance of the others if this one were known.
    other_unknowns = np.delete(np.arange(len(estimate)), j)
    normal = fit.residual.normal(fit.record, fit.solution.x)[1:, 1:]
    covariance = np.zeros_like(normal)
    covariance[np.ix_(other_unknowns, other_unknowns)] = spread**2 * scaled_inverse(
        normal[np.ix_(other_unknowns, other_unknowns)]
    )
    # The shift of all by one standard uncertainty of this one, of which SIGMAS lead to an end. Of both ends the one
    # counts that moves the others more, in units of their own uncertainties.
    std = np.sqrt(covariance.diagonal()[other_unknowns])
    shifts = [(profile.with_held(place, end) - estimate) / SIGMAS for end in (lower, upper)]
    shift = max(shifts, key=lambda moved: float(np.linalg.norm(moved[other_unknowns] / np.maximum(std, _SMALLEST))))
    # An interval that begins at 0 counts as a whole, any other one from the estimate to its farther end.
    reach = upper if lower == 0.0 else max(upper - value, value - lower)
    shift[j] = np.copysign(reach / SIGMAS, shift[j])
    return OneSpeedInterval(lower, upper, covariance + np.outer(shift, shift))
