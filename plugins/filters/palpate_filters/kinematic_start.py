"""States in which the kinematic filter begins: from a fit or a guess, and after a pause."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, Problem, Samples
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_filters.first_guess import first_guess
from palpate_filters.kinematic_settings import KinematicSettings, drift_of, fits
from palpate_filters.kinematic_step import carried
from palpate_filters.process_models import KinematicProcess
from palpate_filters.recursion import Carry
from palpate_filters.starting_fit import BiasPrior, StartFit, fit_start, fittable

FIT_SPREAD = 10.0  # the filter sees the fitted samples again, so it takes only a hundredth of their weight from the fit
ACCELERATION_STD = 1.0  # [m/s^2]
STEEPEST = 0.05  # first standard deviation of a surface's slope
TREND_STD = 0.05  # [1/s]
_LEAST_BIAS = 1e-6  # [N]


def guess_of(settings: KinematicSettings, process: KinematicProcess, problem: Problem) -> Floats:
    """First guesses (k,) of the parameters; raises ConfigurationError where one is impossible."""
    forces = {"elastic": (settings.start_force, 1.0), "viscous": (settings.start_damping, 1.0)}
    given: dict[str, Any] = dict(settings.first_guess)
    guess, _ = first_guess(process.model, forces, given, {}, problem.others)
    for parameter, value in zip(process.model.parameters, guess, strict=True):
        if parameter.lower >= 0 and value <= 0:
            raise ConfigurationError(f"first guess of {parameter.name}: must be above 0")
    return guess


def fresh_state(
    settings: KinematicSettings, process: KinematicProcess, guess: Floats, window: Samples, patient: bool
) -> tuple[Floats, bool] | None:
    """State from a fit of the window if requested and successful, else, once not patient, from the first guess."""
    place, chart = process.layout, process.chart
    mean, std, surface = np.zeros(process.states), np.zeros(process.states), place.at("surface")
    std[surface], std[chart] = 2.0 * settings.start_depth, settings.start_spread
    mean[surface], theta = window.position[0] + settings.start_depth, guess
    std[place["memory"]] = 1.0
    std[place["slope"]], std[place["trend"]] = STEEPEST * settings.sweep_speed, TREND_STD  # on a sweep
    _place(process, settings.position_std, settings.velocity_std, mean, std, window)
    covariance = np.diag(std**2)
    _bias_since_the_tare(settings, process, covariance, float(window.time[0]))
    found = None
    if fits(settings):
        prior = _bias_prior(settings, process, covariance)
        found = fit_start(process.model, process.mass, window, guess, prior, lenient=not patient)
        if found is None and patient and fittable(process.model):
            return None
    if found is not None:
        mean[surface], theta = found.surface, found.theta
        mean[place["bias"]] = found.bias
        covariance = _fitted_covariance(settings, process, found, covariance)
    mean[chart] = process.on_chart(theta.tolist(), math.log)
    return np.concatenate([mean, covariance.ravel(), [0.0], mean[place["bias"]]]), False


def _bias_prior(settings: KinematicSettings, process: KinematicProcess, covariance: Floats) -> BiasPrior | None:
    if not process.biased:
        return None
    where = process.layout.at("bias")
    return BiasPrior(math.sqrt(covariance[where, where]), settings.force_std)


def _bias_since_the_tare(
    settings: KinematicSettings, process: KinematicProcess, covariance: Floats, elapsed: float
) -> None:
    """Put in what is known of bias and drift so many seconds after the tare, which is at the record's beginning."""
    if not process.biased:
        return
    place, drift = process.layout, drift_of(settings)
    grown = (drift * elapsed) ** 2 + settings.drift_walk**2 * elapsed
    covariance[place["bias"], place["bias"]] = settings.bias_std**2 + max(grown, _LEAST_BIAS**2)
    covariance[place["drift"], place["drift"]] = drift**2
    for one, other in (("bias", "drift"), ("drift", "bias")):
        covariance[place[one], place[other]] = drift**2 * elapsed


def _fitted_covariance(
    settings: KinematicSettings, process: KinematicProcess, found: StartFit, before: Floats
) -> Floats:
    """Covariance (n, n) after a fit: with a bias from the fit's full covariance, else of each number alone."""
    place, chart = process.layout, process.chart
    covariance, surface = before.copy(), place.at("surface")
    if not process.biased:
        std, widest = min(FIT_SPREAD * found.surface_std, 2.0 * settings.start_depth), settings.start_spread
        known = found.theta_std > 0
        relative = FIT_SPREAD * np.where(known, found.theta_std, 0.0) / np.abs(found.theta)
        each = np.where(known, np.clip(relative, 1e-3, widest), widest)
        covariance[surface, surface], covariance[chart, chart] = std**2, np.diag(each**2)
        return covariance
    # The surface, the parameters and the bias hang together, and the drift with the bias.
    rows = np.r_[surface, np.arange(chart.start, chart.stop), place.at("bias")]
    information = np.zeros_like(before)
    information[np.ix_(rows, rows)] = found.information / FIT_SPREAD**2
    return scaled_inverse(scaled_inverse(before) + information)


def _place(
    process: KinematicProcess, position_std: float, velocity_std: float, mean: Floats, std: Floats, first: Samples
) -> None:
    """Put the tip where the first sample is."""
    moving, motion = float(first.velocity[0]), process.motion
    mean[motion] = first.position[0], moving if np.isfinite(moving) else 0.0, 0.0
    std[motion] = position_std, velocity_std if np.isfinite(moving) else 0.1, ACCELERATION_STD


def resumed_state(process: KinematicProcess, carry: Carry, first: Samples) -> tuple[Floats, bool]:
    """State after a pause: motion reset, surface and material kept."""
    assert carry.state is not None
    held, last, motion = carried(process), process.layout.span("surface", "trend"), process.motion
    mean, std = carry.state[held["mean"]].copy(), np.zeros(process.states)
    covariance = np.zeros((process.states, process.states))
    before = carry.state[held["covariance"]].reshape(covariance.shape)
    _place(process, 5e-6, 1e-3, mean, std, first)
    covariance[last, last] = before[last, last]
    covariance[motion, motion] = np.diag(std[motion] ** 2)
    return np.concatenate([mean, covariance.ravel(), [0.0], carry.state[held["centre"]]]), True
