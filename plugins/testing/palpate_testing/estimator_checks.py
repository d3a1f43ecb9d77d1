"""Checks of estimators."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from palpate import ContactModel, Estimates, Estimator, Problem, Samples, Status, force_over_time

from palpate_testing.failure_messages import demand

_TIP_MASS = 0.14  # [kg]
_OF_BLOCK = ("details", "flags", "report", "timing_included")  # not of each sample
_COLUMNS = [field.name for field in fields(Estimates) if field.name not in _OF_BLOCK]


def synthetic_samples(
    model: ContactModel, theta: Sequence[float], duration: float = 3.0, rate: float = 500.0, seed: int = 0
) -> Samples:
    """Samples of a tip that is driven through a sine of 2 Hz and 1 mm around a depth of 3 mm, with sensor noise.

    The motion is exact, the surface at height 0; force noise 0.05 N, velocity noise 0.67 mm/s, as in the paper.
    """
    random = np.random.default_rng(seed)
    n = round(duration * rate)
    stamp = np.rint(np.arange(n) * (1e9 / rate)).astype(np.int64)
    time = stamp / 1e9
    omega = 2 * np.pi * 2.0
    depth = 3e-3 + 1e-3 * np.sin(omega * time)
    speed = 1e-3 * omega * np.cos(omega * time)
    acceleration = -1e-3 * omega**2 * np.sin(omega * time)
    force = force_over_time(model, time, depth, speed, theta) + _TIP_MASS * acceleration
    always = np.ones(n, bool)
    return Samples(
        stamp,
        time,
        np.concatenate([[0.0], np.diff(stamp) / 1e9]),
        force + 0.05 * random.standard_normal(n),
        -depth,
        -speed + 0.67e-3 * random.standard_normal(n),
        always,
        always.copy(),
    )


def check_estimator(estimator: Estimator, model: ContactModel, theta: Sequence[float]) -> None:
    """An estimator keeps its promises on a synthetic palpation of a material with parameters `theta`.

    Checked: one estimate for each sample, of the right shape; nothing is estimated out of contact; no negative standard
    deviation; wherever an estimate is not finite, the status says why; the same bits on a second run and, for online
    estimators, however the samples are cut into blocks; a missing measurement is survived.
    """
    name = type(estimator).__name__
    problem = Problem(model, _TIP_MASS)
    samples = synthetic_samples(model, theta)
    samples.active[:200] = False
    whole = estimator.start(problem).run(samples)
    _check_shapes(whole, samples, len(model.parameters), name)
    demand(np.isnan(whole.values[:200]).all() or not estimator.online, f"{name} estimates out of contact")
    again = estimator.start(problem).run(samples)
    demand(_same_bits(whole, again), f"{name} gives other numbers on a second run")
    if estimator.online:
        tracker = estimator.start(problem)
        cuts = [0, 1, 2, 199, 200, 201, 777, 1204, len(samples)]
        blocks = [tracker.run(samples[a:b]) for a, b in pairwise(cuts)]
        columns: dict[str, Any] = {n: np.concatenate([getattr(block, n) for block in blocks]) for n in _COLUMNS}
        joined = replace(blocks[-1], **columns)  # what is said of a block is said by the last
        demand(_same_bits(whole, joined), f"{name} gives other numbers when the samples are cut into blocks")
    samples.force[500:510] = np.nan
    samples.velocity[600:605] = np.nan
    holed = estimator.start(problem).run(samples)
    explained = (holed.status[-1] & (Status.DIVERGED | Status.IDLE)) != 0
    demand(np.isfinite(holed.values[-1]).all() or explained, f"{name} does not survive a missing measurement")
    demand(len(estimator.start(problem).run(samples[:0])) == 0, f"{name} makes estimates of no samples")


def _check_shapes(estimates: Estimates, samples: Samples, parameters: int, name: str) -> None:
    n = len(samples)
    for column in _COLUMNS:
        expected = (n, parameters) if column in ("values", "std") else (n,)
        shape = getattr(estimates, column).shape
        demand(shape == expected, f"{name}: {column} has shape {shape} instead of {expected}")
    demand(not (estimates.std < 0).any(), f"{name} gives a negative standard deviation")
    silent = ~np.isfinite(estimates.values).all(axis=1) & (estimates.status == 0)
    demand(not silent.any(), f"{name} gives no number and no status at {silent.sum()} samples")
    unsure = np.isfinite(estimates.values).all(axis=1) & ~np.isfinite(estimates.std).all(axis=1)
    demand(not unsure.any(), f"{name} gives estimates without an uncertainty at {unsure.sum()} samples")


def _same_bits(one: Estimates, other: Estimates) -> bool:
    same = all(np.array_equal(getattr(one, c), getattr(other, c), equal_nan=c != "status") for c in _COLUMNS)
    return (
        same
        and json.dumps(one.details) == json.dumps(other.details)
        and all(getattr(one, name) == getattr(other, name) for name in _OF_BLOCK[1:])
    )
