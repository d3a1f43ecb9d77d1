"""Viscosities at one speed, which are the height of the surface to first order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse, symmetric_inverse

from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.profile_likelihood import ProfileIntervals
from palpate_fits.uncertainty import ResidualScatter

SIGMAS = 2.0  # standard uncertainties within which a value may be none
CURVED = 2.0  # ratio of uncertainties at 0 and at the estimate, from which on the latter is made by curvature (choice)
SAMPLES = 4000  # whose slopes are taken
SINGULAR = 1e-12  # of the largest eigenvalue of scaled slopes, below which a direction does not count


@dataclass(frozen=True)
class OneSpeedBound:
    """A viscosity that a record does not determine: it is anything from none to a bound."""

    bound: float  # [SI]
    covariance: Floats  # (p, p) of the free unknowns; two standard uncertainties reach to none, or to the bound


def one_speed_bounds(fit: FitOutcome, scatter: ResidualScatter) -> Iterator[tuple[int, OneSpeedBound]]:
    """Yield each viscosity that a record without air determines by its own size alone, by its place among the free.

    F = E a(d) + eta b(d) d' with b proportional to the slope of a: at one speed eta d' b(d) is the force of a surface
    that is higher. The two differ by the square of eta alone, so that noise makes a viscosity out of none, and the
    curvature there claims to know it. So the uncertainty counts that the viscosity would have if it were none. The
    bound is the end of its likelihood profile at two standard uncertainties.
    """
    parameters = fit.problem.model.parameters
    for j, place in enumerate(fit.residual.free):
        is_viscous = place < len(parameters) and parameters[place].role == "viscous" and parameters[place].lower == 0.0
        if not is_viscous or fit.problem.model.memory:
            continue
        std_if_none, std_if_alone = _std_if_none(fit, scatter, j)
        is_curved = std_if_none > CURVED * float(np.sqrt(scatter.covariance[j, j]))
        if is_curved and fit.solution.x[place] <= SIGMAS * std_if_none and fit.begins_in_contact():
            yield j, _bound(fit, scatter, j, std_if_alone)


def _std_if_none(fit: FitOutcome, scatter: ResidualScatter, j: int) -> tuple[float, float]:
    """Return the standard uncertainties of the j-th free unknown by the slopes where it is 0: others free, and known.

    A noisy rate adds what no other unknown can follow, which is taken off: the share of its noise in its mean square.
    """
    record, x = fit.record.thinned(SAMPLES), fit.solution.x.copy()
    x[fit.residual.free[j]] = 0.0
    square = fit.residual.normal(record, x)[1:, 1:] * (len(fit.record) / max(len(record), 1))
    lengths = np.sqrt(square.diagonal())
    if not lengths[j] > 0:
        return np.inf, 1.0
    lengths[~(lengths > 0)] = 1.0
    scaled = square / (lengths[:, None] * lengths)
    others = np.delete(np.arange(len(scaled)), j)
    followed = scaled[j, others] @ symmetric_inverse(scaled[np.ix_(others, others)], SINGULAR) @ scaled[others, j]
    rate = fit.record.rate[fit.record.used]
    noise = fit.motion.rate_noise**2 / max(float(np.mean(rate**2)), 1e-300)
    share, alone = 1.0 - float(followed) - noise, _spread(scatter) / float(lengths[j])
    return alone / np.sqrt(share) if share > 0 else np.inf, alone


def _spread(scatter: ResidualScatter) -> float:
    """Return the standard deviation [N] that independent residuals of the same weight would have."""
    return float(np.sqrt(scatter.rss / max(scatter.effective_samples, 1.0)))


def _bound(fit: FitOutcome, scatter: ResidualScatter, j: int, step: float) -> OneSpeedBound:
    """Return the bound of the j-th free unknown, searched from a first step, and what it leaves of the others."""
    place, estimate = fit.residual.free[j], fit.solution.x[list(fit.residual.free)]
    profile = ProfileIntervals(fit.residual, fit.unknowns, fit.record, fit.solution.x, fit.loss)
    bound = max(profile.upper_end(place, SIGMAS, step, _spread(scatter)) or 0.0, float(estimate[j]))
    # Covariance of the others if this one were known.
    others = np.delete(np.arange(len(estimate)), j)
    normal = fit.residual.normal(fit.record, fit.solution.x)[1:, 1:]
    covariance = np.zeros_like(normal)
    covariance[np.ix_(others, others)] = _spread(scatter) ** 2 * scaled_inverse(normal[np.ix_(others, others)])
    # What it does to them, at the end that is farther in units of that; twice this shift leads there.
    std = np.sqrt(covariance.diagonal()[others])
    shifts = [(profile.with_held(place, end) - estimate) / SIGMAS for end in (0.0, bound)]
    shift = max(shifts, key=lambda one: float(np.linalg.norm(one[others] / np.maximum(std, 1e-300))))
    shift[j] = np.copysign(bound / SIGMAS, shift[j])
    return OneSpeedBound(bound, covariance + np.outer(shift, shift))
