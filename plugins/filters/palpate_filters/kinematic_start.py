"""States in which the kinematic filter begins: from a fit or a guess, and after a pause."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, Problem, Samples
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_filters.first_guess import first_guess
from palpate_filters.kinematic_settings import KinematicSettings, drift_of, fits
from palpate_filters.kinematic_step import state_layout
from palpate_filters.process_models import KinematicProcess
from palpate_filters.recursion import Carry
from palpate_filters.starting_fit import BiasPrior, StartFit, fit_start, fittable
from palpate_filters.step_limits import FIT_SPREAD

ACCELERATION_STD = 1.0  # [m/s^2], a choice: first standard deviation of the tip's acceleration
SLOPE_STD = 0.05  # a choice: first standard deviation of the inclination of a surface under a sweep
TREND_STD = 0.05  # [1/s], a choice: first standard deviation of the trend of the first logarithm
_UNKNOWN_VELOCITY_STD = 0.1  # [m/s], a choice: of a missing first velocity
_RESUMED_POSITION_STD = 5e-6  # [m], the default `position_std` of `KinematicSettings`
_RESUMED_VELOCITY_STD = 1e-3  # [m/s], a choice near the default `velocity_std`
_MIN_BIAS_GROWTH = 1e-6  # [N], a choice: keeps the covariance of bias and drift regular right after the tare
_MIN_RELATIVE_STD = 1e-3  # a choice: no fit determines a parameter better for the filter


def guess_of(settings: KinematicSettings, process: KinematicProcess, problem: Problem) -> Floats:
    """Return first guesses (k,) of the parameters; raises ConfigurationError where one is impossible."""
    forces = {"elastic": (settings.start_force, 1.0), "viscous": (settings.start_damping, 1.0)}
    stated: dict[str, Any] = dict(settings.first_guess)
    guess, _ = first_guess(process.model, forces, stated, {}, problem.others)
    for parameter, value in zip(process.model.parameters, guess, strict=True):
        if parameter.lower >= 0 and value <= 0:
            raise ConfigurationError(f"first guess of {parameter.name}: must be above 0")
    return guess


def fresh_state(
    settings: KinematicSettings, process: KinematicProcess, guess: Floats, window: Samples, patient: bool
) -> tuple[Floats, bool] | None:
    """Return a first state from a fit of the window where requested, else from the guess; never resumed (False).

    None where the fit fails and a longer window may help: while `patient`, with a model that can be fitted.
    """
    layout, chart = process.layout, process.chart
    mean, covariance = _guessed_state(settings, process, window)
    theta, fit = guess, None
    if fits(settings):
        prior = _bias_prior(settings, process, covariance)
        fit = fit_start(process.model, process.mass, window, guess, prior, lenient=not patient)
        if fit is None and patient and fittable(process.model):
            return None
    if fit is not None:
        theta = fit.theta
        mean[layout.at("surface")] = fit.surface
        mean[layout["bias"]] = fit.bias
        covariance = _fitted_covariance(settings, process, fit, covariance)
    mean[chart] = process.on_chart(theta.tolist(), math.log)
    low_count = 0.0
    return np.concatenate([mean, covariance.ravel(), [low_count], mean[layout["bias"]]]), False


def _guessed_state(settings: KinematicSettings, process: KinematicProcess, window: Samples) -> tuple[Floats, Floats]:
    """Return mean (n,), without the parameters, and covariance (n, n) before any fit."""
    layout, surface = process.layout, process.layout.at("surface")
    mean, std = np.zeros(process.states), np.zeros(process.states)
    mean[surface] = window.position[0] + settings.start_depth
    std[surface] = 2.0 * settings.start_depth  # a choice: it includes a tip that is not in contact yet
    std[process.chart] = settings.start_spread
    std[layout["memory"]] = 1.0  # a choice, in the units of the model's internal states
    # On a sweep.
    std[layout["slope"]] = SLOPE_STD * settings.sweep_speed
    std[layout["trend"]] = TREND_STD
    _put_motion(process, settings.position_std, settings.velocity_std, mean, std, first=window)
    covariance = np.diag(std**2)
    _put_bias_covariance(settings, process, covariance, float(window.time[0]))
    return mean, covariance


def _bias_prior(settings: KinematicSettings, process: KinematicProcess, covariance: Floats) -> BiasPrior | None:
    """Return the bias's prior for the starting fit; None without a bias."""
    if not process.biased:
        return None
    row = process.layout.at("bias")
    return BiasPrior(math.sqrt(covariance[row, row]), settings.force_std)


def _put_bias_covariance(
    settings: KinematicSettings, process: KinematicProcess, covariance: Floats, elapsed: float
) -> None:
    """Put in the covariance of bias and drift `elapsed` seconds after the tare, which is at the record's beginning.

    A bias b of standard deviation s_b at the tare, with a constant drift of s_d and a random walk w::

        var(b) = s_b^2 + s_d^2 t^2 + w^2 t        var(drift) = s_d^2        cov = s_d^2 t
    """
    if not process.biased:
        return
    bias, drift = process.layout["bias"], process.layout["drift"]
    drift_std = drift_of(settings)
    growth = (drift_std * elapsed) ** 2 + settings.drift_walk**2 * elapsed
    covariance[bias, bias] = settings.bias_std**2 + max(growth, _MIN_BIAS_GROWTH**2)
    covariance[drift, drift] = drift_std**2
    covariance[bias, drift] = drift_std**2 * elapsed
    covariance[drift, bias] = drift_std**2 * elapsed


def _fitted_covariance(settings: KinematicSettings, process: KinematicProcess, fit: StartFit, before: Floats) -> Floats:
    """Return the covariance (n, n) after a fit: with a bias by the fit's full covariance, else of each number alone.

    `before` (n, n) is that of the guess, which no number exceeds. Deviations of the fit are `FIT_SPREAD` times as large
    for the filter, which sees the fitted samples again.
    """
    chart, surface = process.chart, process.layout.at("surface")
    if not process.biased:
        covariance = before.copy()
        surface_std = min(FIT_SPREAD * fit.surface_std, 2.0 * settings.start_depth)
        is_fitted = fit.theta_std > 0
        relative_std = FIT_SPREAD * np.where(is_fitted, fit.theta_std, 0.0) / np.abs(fit.theta)
        bounded_std = np.clip(relative_std, _MIN_RELATIVE_STD, settings.start_spread)
        chart_std = np.where(is_fitted, bounded_std, settings.start_spread)
        covariance[surface, surface] = surface_std**2
        covariance[chart, chart] = np.diag(chart_std**2)
        return covariance
    # Surface, parameters and bias are correlated, and the drift with the bias: the information of fit and prior add.
    rows = np.r_[surface, np.arange(chart.start, chart.stop), process.layout.at("bias")]
    information = np.zeros_like(before)
    information[np.ix_(rows, rows)] = fit.information / FIT_SPREAD**2
    return scaled_inverse(scaled_inverse(before) + information)


def _put_motion(
    process: KinematicProcess, position_std: float, velocity_std: float, mean: Floats, std: Floats, first: Samples
) -> None:
    """Put in the tip's motion at the first sample; a missing velocity counts as 0 with `_UNKNOWN_VELOCITY_STD`."""
    velocity, motion = float(first.velocity[0]), process.motion
    is_present = np.isfinite(velocity)
    mean[motion] = first.position[0], velocity if is_present else 0.0, 0.0
    std[motion] = position_std, velocity_std if is_present else _UNKNOWN_VELOCITY_STD, ACCELERATION_STD


def resumed_state(process: KinematicProcess, carry: Carry, first: Samples) -> tuple[Floats, bool]:
    """Return the state after a pause, resumed (True): motion by the first sample, surface and material kept.

    `carry` has the filter's state after the last sample.
    """
    assert carry.state is not None
    carried, motion = state_layout(process), process.motion
    material = process.layout.span("surface", "trend")
    mean, std = carry.state[carried["mean"]].copy(), np.zeros(process.states)
    covariance = np.zeros((process.states, process.states))
    before = carry.state[carried["covariance"]].reshape(covariance.shape)
    _put_motion(
        process, position_std=_RESUMED_POSITION_STD, velocity_std=_RESUMED_VELOCITY_STD, mean=mean, std=std, first=first
    )
    covariance[material, material] = before[material, material]
    covariance[motion, motion] = np.diag(std[motion] ** 2)
    low_count = 0.0
    return np.concatenate([mean, covariance.ravel(), [low_count], carry.state[carried["centre"]]]), True
