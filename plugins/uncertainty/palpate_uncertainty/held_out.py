"""Predictions of a fit for data that it has not used: blocks of a record, each left out in turn."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Estimates, Estimator, Floats, Problem, Samples, contact_force, force_over_time

# Choices, of `palpate fit choose` alone: no verdict depends on them.
_BLOCKS = 4  # in time, each of which is predicted from the others
_CUBIC_SAMPLES = 15  # samples of the local cubic for depth, rate and acceleration
_MIN_SAMPLES = 100  # samples of a block


def held_out(model: ContactModel, estimator: Estimator, problem: Problem, samples: Samples) -> Floats:
    """Return the RMS [N] of force less forecast in each of four blocks (4,) of a record, by fits to the other three.

    Blocks are equally long parts of the active samples. A model with memory runs over the whole record, so that its
    forecast of a block depends on the motion there and never on the force. NaN where the fit failed; empty for a record
    that is too short. The estimator is one that fits the `active` samples.
    """
    used = np.flatnonzero(samples.active & np.isfinite(samples.force) & np.isfinite(samples.position))
    if len(used) < _BLOCKS * _MIN_SAMPLES:
        return np.zeros(0)
    edge_rows = [min(i * len(used) // _BLOCKS, len(used) - 1) for i in range(_BLOCKS + 1)]
    edges = samples.time[used[edge_rows]]
    # A fit of values alone, once for each block that is hidden from it.
    changes: dict[str, Any] = {"segment": "active", "profile": False, "bootstrap": 0}
    plain_fit = estimator.model_copy(update=changes)
    errors: list[float] = []
    for begin, end in pairwise(edges):
        is_hidden = (samples.time >= begin) & (samples.time < end)
        visible = replace(samples, active=samples.active & ~is_hidden)
        fit = plain_fit.start(replace(problem, model=model)).run(visible)
        hidden_rows = used[is_hidden[used]]
        errors.append(_forecast_error(model, problem.tip_mass or 0.0, samples, fit, hidden_rows))
    return np.array(errors)


def _forecast_error(
    model: ContactModel, mass: float, samples: Samples, fit: Estimates, rows: NDArray[np.intp]
) -> float:
    """Return the RMS [N] of force less a fit's forecast in some rows of the samples; NaN where the fit failed."""
    estimated = np.flatnonzero(np.isfinite(fit.values).all(axis=1))
    if not len(estimated) or fit.report is None:
        return float("nan")
    theta, surface = fit.values[estimated[0]], float(fit.surface[estimated[0]])
    forecast = _forecast(model, mass, samples, theta, surface) + fit.report.bias
    return float(np.sqrt(np.nanmean((samples.force[rows] - forecast[rows]) ** 2)))


def _forecast(model: ContactModel, mass: float, samples: Samples, theta: Floats, surface: float) -> Floats:
    """Return the readings (n,) [N] of the sensor, without a bias."""
    is_finite: NDArray[np.bool_] = np.isfinite(samples.position)
    height = np.interp(samples.time, samples.time[is_finite], samples.position[is_finite])
    depth, rate, acceleration = _smooth(surface - height, float(np.median(np.diff(samples.time))))
    if model.memory:
        force = force_over_time(model, samples.time, depth, rate, theta.tolist(), pulls=False)
    else:
        force = np.asarray(contact_force(model, depth, rate, theta.tolist(), pulls=False), float)
    return np.asarray(force + mass * acceleration)


def _smooth(depth: Floats, step: float) -> tuple[Floats, Floats, Floats]:
    """Return depth [m], rate and acceleration (n,) by local cubics over samples `step` [s] apart."""
    from scipy.signal import savgol_filter

    return (
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3)),
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3, deriv=1, delta=step)),
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3, deriv=2, delta=step)),
    )
