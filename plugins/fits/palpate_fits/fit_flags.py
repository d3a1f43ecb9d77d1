"""Flags of a fit: of its convergence and bounds, of its residual, and of what the record does not determine."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from palpate import Flag, Floats
from palpate_kit.terminal.quantities import number_with_unit

from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.fit_uncertainty import FitWithUncertainty
from palpate_fits.height_noise import force_noise
from palpate_fits.identifiability import INDISTINCT
from palpate_fits.uncertainty import ResidualScatter

_MAX_NOISE_RATIO = 2.0  # of the residual's RMS over its white noise, beyond which it is a misfit (choice)
_LONG_CORRELATION = 50.0  # [samples] of the residuals, beyond which they are not noise (choice)
_USELESS_STD = 0.5  # of an elastic parameter, beyond which it is not identifiable (choice)
_UPPER_SIGMAS = 2.0  # standard uncertainties up to which a viscosity of 0 may be (choice)
_TWO_SPEEDS = "Press at two speeds or oscillate, in which a viscosity shows."
_STATE_SKIN = 'State the height of the skin, which mends it: fixed = { surface = "0.3 mm" } of the fit.'


def fit_flags(evaluated: FitWithUncertainty, total: Floats) -> Iterator[Flag]:
    """Yield the flags of a fit, with standard uncertainties (P,) of all parameters."""
    solution = evaluated.fit.solution
    if not solution.converged:
        yield Flag(
            "not-converged", f"the solver {evaluated.fit.solver} stopped after {solution.evaluations} evaluations"
        )
    yield from _bound_flags(evaluated, total)
    yield from _residual_flags(evaluated.fit, evaluated.scatter)
    yield from _identifiability_flags(evaluated, total)


def _bound_flags(evaluated: FitWithUncertainty, total: Floats) -> Iterator[Flag]:
    """Yield the flags of unknowns at a bound; a viscosity whose bound is 0 has an upper end only.

    `total` has the standard uncertainties (P,) of all parameters, which are the effects of the flags.
    """
    fit = evaluated.fit
    names = fit.unknowns.names
    model_names = {parameter.name for parameter in fit.problem.model.parameters}
    for j, place in enumerate(fit.residual.free):
        name, unit = names[place], fit.unknowns.items[place].unit
        one_speed = evaluated.one_speed.get(j)
        if one_speed is not None and one_speed.lower == 0.0:
            upper = number_with_unit(one_speed.upper, unit)
            text = f"{name} is at most {upper}: at one speed it is the height of the surface to first order"
            yield Flag("undetermined", text, effects={name: float(total[place])}, remedy=_TWO_SPEEDS)
        elif evaluated.at_bound[j] and _is_zero_viscosity(fit, place):
            upper = number_with_unit(_UPPER_SIGMAS * total[place], unit)
            text = f"{name} is zero, or at most {upper}"
            yield Flag("undetermined", text, effects={name: float(total[place])}, remedy=_TWO_SPEEDS)
        elif evaluated.at_bound[j]:
            is_by_force = name == "surface" and fit.settings.force_uncertainty is not None
            bound = "where the measured force leaves force_uncertainty" if is_by_force else "a bound"
            number = number_with_unit(fit.solution.x[place], unit, 5)  # digits: a bound is known exactly
            text = f"{name} is at {bound}, {number}"
            yield Flag("at-bound", text, effects={name: math.inf} if name in model_names else None)


def _is_zero_viscosity(fit: FitOutcome, place: int) -> bool:
    """Return True if a viscosity or damping is at 0, its lower bound: the record shows none of it."""
    parameters = fit.problem.model.parameters
    return place < len(parameters) and parameters[place].role == "viscous" and fit.solution.x[place] <= 0.0


def _residual_flags(fit: FitOutcome, scatter: ResidualScatter) -> Iterator[Flag]:
    """Yield the flags of a residual that is more than noise, or that correlates over many samples.

    `scatter` has the size and correlation of the residuals. The noise is that of the force in air, together with that
    of its last digit; where the record has no air, the white noise of the residual itself. In contact the noise of the
    height adds to that of the air.
    """
    rms = float(np.sqrt(scatter.rss / max(scatter.samples, 1)))
    approach = fit.by_force.approach
    noise = math.hypot(scatter.noise if approach is None else approach.noise, fit.digit.noise)
    if approach is not None and rms > _MAX_NOISE_RATIO * noise:
        surface = fit.unknowns.index("surface")
        noise = float(np.hypot(noise, force_noise(fit.residual, fit.record, fit.solution.x, surface)))
    if noise > 0 and rms > _MAX_NOISE_RATIO * noise:
        text = f"the residual of {rms:.3g} N is more than noise, {noise:.3g} N: something is not in the model"
        yield Flag("misfit", text)
    if scatter.correlation_time > _LONG_CORRELATION:
        yield Flag(
            "correlated-residuals",
            f"the residuals are not noise: they correlate over {scatter.correlation_time:.3g} samples, so "
            f"{scatter.samples} count as {scatter.effective_samples:.3g}",
        )


def _identifiability_flags(evaluated: FitWithUncertainty, total: Floats) -> Iterator[Flag]:
    """Yield the flags of unknowns without an effect, of pairs that are hard to distinguish, and of useless values.

    `total` has the standard uncertainties (P,) of all parameters.
    """
    for name in evaluated.identifiability["without_effect"]:
        yield Flag("not-identifiable", f"{name} has no effect on the force in this record")
    # With a correlation of 0.9, from which on a pair is listed, a value is 1/sqrt(1 - 0.9^2) = 2.3 times better known
    # where the skin is.
    fitted_pairs = [pair for pair in evaluated.identifiability["pairs"] if pair["both_fitted"]]
    helped_by_skin: set[str] = set()
    for pair in fitted_pairs:
        names = {pair["first"], pair["second"]}
        if "surface" in names:
            helped_by_skin |= names
    for pair in fitted_pairs:
        if abs(pair["correlation"]) > INDISTINCT:
            text = f"{pair['first']} and {pair['second']} (correlation {pair['correlation']:+.5f})"
            remedy = _STATE_SKIN if helped_by_skin & {pair["first"], pair["second"]} else ""
            yield Flag("hard-to-tell-apart", text, effects={}, remedy=remedy)
    # An elastic value that is less certain than a share of it.
    estimate = evaluated.fit.solution.x.tolist()
    for parameter, value, std in zip(evaluated.fit.problem.model.parameters, estimate, total.tolist(), strict=False):
        if parameter.role == "elastic" and std > _USELESS_STD * abs(value):
            number, uncertainty = number_with_unit(value, parameter.unit), number_with_unit(std, parameter.unit)
            remedy = _STATE_SKIN if parameter.name in helped_by_skin else ""
            yield Flag("not-identifiable", f"{parameter.name} of {number} has a std of {uncertainty}", remedy=remedy)
