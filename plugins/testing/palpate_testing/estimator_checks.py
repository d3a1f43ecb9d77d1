"""Checks of estimators."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np
from palpate import ContactModel, Estimates, Estimator, Problem, Samples, Status

from palpate_testing.failure_messages import demand
from palpate_testing.standard_set_checks import check_standard_set
from palpate_testing.truth_checks import check_truth
from palpate_testing.truth_records import TIP_MASS, PressMotion

_OF_BLOCK = ("details", "flags", "report", "timing_included")  # not of each sample
DURATION = 2.0  # [s] of the record, so that a filter that steps in Python is checked in a second
_COLUMNS = [field.name for field in fields(Estimates) if field.name not in _OF_BLOCK]


def synthetic_samples(
    model: ContactModel, theta: Sequence[float], duration: float = 3.0, rate: float = 500.0, seed: int = 0
) -> Samples:
    """Samples of a tip that is driven through a sine of 2 Hz and 1 mm around a depth of 3 mm, with sensor noise.

    The motion is exact, the surface at height 0; force noise 0.05 N, velocity noise 0.67 mm/s, as in the paper.
    """
    return PressMotion(duration=duration, rate=rate).samples(model, theta, TIP_MASS, seed)


def check_estimator(
    estimator: Estimator,
    model: ContactModel,
    theta: Sequence[float],
    *,
    truth: bool = False,
    standard_set: bool = False,
) -> None:
    """Check that an estimator keeps its promises on a synthetic palpation of a material with parameters `theta`.

    Checked: one estimate for each sample, of its time and the right shape; nothing is estimated out of contact; no
    negative standard deviation; wherever an estimate is not finite, the status says why; the tip is below the surface;
    the same bits on a second run and, for online estimators, however the samples are cut into blocks; the samples are
    left as they are; an online estimator takes less time than the record; a missing measurement is survived.
    With `truth` its values are checked, too, on 40 records of known parameters, which takes some seconds; see
    `check_truth`. With `standard_set` it runs on two records of at most 3 s of each scene of `palpate bench`, with the
    model of the scene; see `check_standard_set`. Raises AssertionError with the reason.
    """
    name = type(estimator).__name__
    problem = Problem(model, TIP_MASS)
    samples = synthetic_samples(model, theta, DURATION)
    samples.active[:200] = False
    untouched = {column.name: getattr(samples, column.name).copy() for column in fields(samples)}
    whole = estimator.start(problem).run(samples)
    for column, values in untouched.items():
        is_same = np.array_equal(getattr(samples, column), values, equal_nan=values.dtype.kind == "f")
        demand(is_same, f"{name} writes into the {column} of its samples, which all plugins share")
    _check_shapes(whole, samples, len(model.parameters), name)
    demand(np.array_equal(whole.time, samples.time), f"{name}: the times of its estimates are not those of the samples")
    _check_depth(whole, samples, name)
    demand(np.isnan(whole.values[:200]).all() or not estimator.online, f"{name} estimates out of contact")
    _check_second_run(estimator, problem, samples, whole)
    # Some readings are missing, and a fifth of a second of readings follows.
    beginning = samples[:700]
    holed = replace(beginning, force=beginning.force.copy(), velocity=beginning.velocity.copy())
    holed.force[500:510] = np.nan
    holed.velocity[600:605] = np.nan
    survived = estimator.start(problem).run(holed)
    explained = (survived.status[-1] & (Status.DIVERGED | Status.IDLE)) != 0
    demand(np.isfinite(survived.values[-1]).all() or explained, f"{name} does not survive a missing measurement")
    demand(len(estimator.start(problem).run(samples[:0])) == 0, f"{name} makes estimates of no samples")
    if truth:
        check_truth(estimator, model, theta)
    if standard_set:
        check_standard_set(estimator)


def _check_second_run(estimator: Estimator, problem: Problem, samples: Samples, whole: Estimates) -> None:
    """Compare the estimates of one block with a second run, whose blocks have many lengths for an online estimator.

    An online estimator has compiled whatever it compiles, and takes less time of the processor than the record.
    """
    name = type(estimator).__name__
    cuts = [0, 1, 2, 199, 200, 201, 577, 804, len(samples)] if estimator.online else [0, len(samples)]
    begin = process_time()
    tracker = estimator.start(problem)
    blocks = [tracker.run(samples[a:b]) for a, b in pairwise(cuts)]
    spent, duration = process_time() - begin, float(samples.time[-1] - samples.time[0])
    is_fast = spent <= duration or not estimator.online
    demand(is_fast, f"{name} takes {spent:.2g} s for a record of {duration:.2g} s: a run falls behind")
    columns: dict[str, Any] = {n: np.concatenate([getattr(block, n) for block in blocks]) for n in _COLUMNS}
    if _same_bits(whole, replace(blocks[-1], **columns)):  # what is said of a block is said by the last
        return
    # A third run shows whether the cuts make the difference.
    again = estimator.start(problem).run(samples)
    demand(_same_bits(whole, again), f"{name} gives other numbers on a second run")
    raise AssertionError(f"{name} gives other numbers when the samples are cut into blocks")


def _check_depth(estimates: Estimates, samples: Samples, name: str) -> None:
    """Check that the tip is below the estimated surface (n,) at most samples, which shows the sign of its height."""
    depth = estimates.surface - samples.position
    known = depth[np.isfinite(depth) & (estimates.status == 0)]
    is_below = len(known) == 0 or float(np.mean(known > 0)) > 0.5
    demand(is_below, f"{name}: the tip in contact is above the estimated surface; is its sign right?")


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
