"""Predictions of a fit for data it was not given: blocks of a record, each left out in turn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Estimator, Floats, Problem, Samples, contact_force, force_over_time

_BLOCKS = 4  # in time, each of which is predicted from the others
_CUBIC_SAMPLES = 15  # samples of the local cubic for depth, rate and acceleration
_MIN_SAMPLES = 100  # samples of a block


def held_out(model: ContactModel, estimator: Estimator, problem: Problem, samples: Samples) -> Floats:
    """Root mean square [N] of force less forecast in each of four blocks of a record, by fits to the other three.

    Blocks are equally long parts of what is meant for estimation. A model that remembers is carried along the whole
    record, so that what it knows of a block is its motion and never its force. NaN where nothing was fitted; empty for
    a record that is too short. The estimator is one that fits what is `active`.
    """
    used = np.flatnonzero(samples.active & np.isfinite(samples.force) & np.isfinite(samples.position))
    if len(used) < _BLOCKS * _MIN_SAMPLES:
        return np.zeros(0)
    edges = [samples.time[used[min(i * len(used) // _BLOCKS, len(used) - 1)]] for i in range(_BLOCKS + 1)]
    found = []
    changes: dict[str, Any] = {"segment": "active", "profile": False, "bootstrap": 0}
    again = estimator.model_copy(update=changes)
    for i in range(_BLOCKS):
        hidden = (samples.time >= edges[i]) & (samples.time < edges[i + 1])
        shown = replace(samples, active=samples.active & ~hidden)
        fit = again.start(replace(problem, model=model)).run(shown)
        rows = used[hidden[used]]
        valid = np.flatnonzero(np.isfinite(fit.values).all(axis=1))
        if not len(valid) or fit.report is None:
            found.append(float("nan"))
            continue
        theta, surface = fit.values[valid[0]], float(fit.surface[valid[0]])
        forecast = _forecast(model, problem.tip_mass or 0.0, samples, theta, surface) + fit.report.bias
        found.append(float(np.sqrt(np.nanmean((samples.force[rows] - forecast[rows]) ** 2))))
    return np.array(found)


def _forecast(model: ContactModel, mass: float, samples: Samples, theta: Floats, surface: float) -> Floats:
    """Readings (n,) [N] of the sensor, without a bias."""
    known: NDArray[np.bool_] = np.isfinite(samples.position)
    place = np.interp(samples.time, samples.time[known], samples.position[known])
    depth, rate, bend = _smooth(surface - place, float(np.median(np.diff(samples.time))))
    if model.memory:
        force = force_over_time(model, samples.time, depth, rate, theta.tolist(), pulls=False)
    else:
        force = np.asarray(contact_force(model, depth, rate, theta.tolist(), pulls=False), float)
    return np.asarray(force + mass * bend)


def _smooth(depth: Floats, step: float) -> tuple[Floats, Floats, Floats]:
    from scipy.signal import savgol_filter

    return (
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3)),
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3, deriv=1, delta=step)),
        np.asarray(savgol_filter(depth, _CUBIC_SAMPLES, 3, deriv=2, delta=step)),
    )
