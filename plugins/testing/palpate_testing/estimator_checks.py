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

BLOCK_FIELDS = ("details", "flags", "report", "timing_included")  # of a block, not of each sample
SAMPLE_FIELDS = [field.name for field in fields(Estimates) if field.name not in BLOCK_FIELDS]
DURATION = 2.0  # [s] of the record, so that a filter that steps in Python is checked in a second
IDLE_SAMPLES = 200  # at the beginning of the record, out of contact (a choice)
# Readings that are missing of a record's beginning (choices): some of the force, then of the velocity, and a fifth of a
# second of whole readings after them.
RECORD_WITH_GAPS, FORCE_GAP, VELOCITY_GAP = slice(700), slice(500, 510), slice(600, 605)
# Ends of the blocks of an online estimator (choices): of one sample, across the touch, and long ones.
BLOCK_ENDS = [0, 1, 2, 199, 200, 201, 577, 804]


def synthetic_samples(
    model: ContactModel, theta: Sequence[float], duration: float = 3.0, rate: float = 500.0, seed: int = 0
) -> Samples:
    """Return samples of a tip that is driven through a sine of 2 Hz and 1 mm around a depth of 3 mm, with noise.

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
    samples.active[:IDLE_SAMPLES] = False
    estimates = _run_without_writing(estimator, problem, samples)
    _check_shapes(estimates, samples, len(model.parameters), name)
    is_same_time = np.array_equal(estimates.time, samples.time)
    demand(is_same_time, f"{name}: the times of its estimates are not those of the samples")
    _check_depth(estimates, samples, name)
    is_silent = np.isnan(estimates.values[:IDLE_SAMPLES]).all()
    demand(is_silent or not estimator.online, f"{name} estimates out of contact")
    _check_second_run(estimator, problem, samples, estimates)
    _check_missing_readings(estimator, problem, samples)
    demand(len(estimator.start(problem).run(samples[:0])) == 0, f"{name} makes estimates of no samples")
    if truth:
        check_truth(estimator, model, theta)
    if standard_set:
        check_standard_set(estimator)


def _run_without_writing(estimator: Estimator, problem: Problem, samples: Samples) -> Estimates:
    """Return the estimates of samples; raises AssertionError where the estimator changes the samples."""
    copies = {field.name: getattr(samples, field.name).copy() for field in fields(samples)}
    estimates = estimator.start(problem).run(samples)
    for name, copy in copies.items():
        is_same = np.array_equal(getattr(samples, name), copy, equal_nan=copy.dtype.kind == "f")
        demand(is_same, f"{type(estimator).__name__} writes into the {name} of its samples, which all plugins share")
    return estimates


def _check_missing_readings(estimator: Estimator, problem: Problem, samples: Samples) -> None:
    """Check that an estimator has a number again after missing readings, or a status that explains why not."""
    record = samples[RECORD_WITH_GAPS]
    record = replace(record, force=record.force.copy(), velocity=record.velocity.copy())
    record.force[FORCE_GAP] = np.nan
    record.velocity[VELOCITY_GAP] = np.nan
    estimates = estimator.start(problem).run(record)
    is_explained = (estimates.status[-1] & (Status.DIVERGED | Status.IDLE)) != 0
    has_survived = np.isfinite(estimates.values[-1]).all() or is_explained
    demand(has_survived, f"{type(estimator).__name__} does not survive a missing measurement")


def _check_second_run(estimator: Estimator, problem: Problem, samples: Samples, estimates: Estimates) -> None:
    """Compare the estimates of one block with a second run, whose blocks have many lengths for an online estimator.

    On a second run an online estimator has compiled everything, and takes less processor time than the record lasts.
    """
    name = type(estimator).__name__
    ends = [*BLOCK_ENDS, len(samples)] if estimator.online else [0, len(samples)]
    start_time = process_time()
    tracker = estimator.start(problem)
    blocks = [tracker.run(samples[start:end]) for start, end in pairwise(ends)]
    spent, duration = process_time() - start_time, float(samples.time[-1] - samples.time[0])
    is_fast = spent <= duration or not estimator.online
    demand(is_fast, f"{name} takes {spent:.2g} s for a record of {duration:.2g} s: a run falls behind")
    joined: dict[str, Any] = {}
    for field in SAMPLE_FIELDS:
        joined[field] = np.concatenate([getattr(block, field) for block in blocks])
    # The fields of a block are those of the last one.
    if _has_same_bits(estimates, replace(blocks[-1], **joined)):
        return
    # A third run shows whether the blocks make the difference.
    third_estimates = estimator.start(problem).run(samples)
    demand(_has_same_bits(estimates, third_estimates), f"{name} gives other numbers on a second run")
    raise AssertionError(f"{name} gives other numbers when the samples are cut into blocks")


def _check_depth(estimates: Estimates, samples: Samples, name: str) -> None:
    """Check that the tip is below the estimated surface at more than half of the samples, as the sign of z demands."""
    depth = estimates.surface - samples.position
    valid_depth = depth[np.isfinite(depth) & (estimates.status == 0)]
    is_below = len(valid_depth) == 0 or float(np.mean(valid_depth > 0)) > 0.5
    demand(is_below, f"{name}: the tip in contact is above the estimated surface; is its sign right?")


def _check_shapes(estimates: Estimates, samples: Samples, parameters: int, name: str) -> None:
    """Check shapes (n,) and (n, parameters); that each sample has a number or a status, and a number an uncertainty."""
    n = len(samples)
    for column in SAMPLE_FIELDS:
        expected = (n, parameters) if column in ("values", "std") else (n,)
        shape = getattr(estimates, column).shape
        demand(shape == expected, f"{name}: {column} has shape {shape} instead of {expected}")
    demand(not (estimates.std < 0).any(), f"{name} gives a negative standard deviation")
    silent = ~np.isfinite(estimates.values).all(axis=1) & (estimates.status == 0)
    demand(not silent.any(), f"{name} gives no number and no status at {silent.sum()} samples")
    unsure = np.isfinite(estimates.values).all(axis=1) & ~np.isfinite(estimates.std).all(axis=1)
    demand(not unsure.any(), f"{name} gives estimates without an uncertainty at {unsure.sum()} samples")


def _has_same_bits(estimates: Estimates, other: Estimates) -> bool:
    """Return True if two estimates are the same to the bit; NaN equals NaN."""
    for name in SAMPLE_FIELDS:
        if not np.array_equal(getattr(estimates, name), getattr(other, name), equal_nan=name != "status"):
            return False
    # Details may have NaN, which is the same as a text.
    has_same_details = json.dumps(estimates.details) == json.dumps(other.details)
    return has_same_details and all(getattr(estimates, name) == getattr(other, name) for name in BLOCK_FIELDS[1:])
