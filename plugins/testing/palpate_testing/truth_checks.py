"""Checks of an estimator's values on 40 records of known truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import ContactModel, Estimator, Floats, Problem

from palpate_testing.failure_messages import demand
from palpate_testing.truth_records import TIP_MASS, Errors, PressMotion, estimate_records

# Four quiet records, on which no noise in a filter's state biases it, and 36 with the noise of the paper's sensors.
QUIET, QUIET_RECORDS = PressMotion(amplitude=2e-3, duration=4.0, rate=500.0, noise=0.05), 4
NOISY, NOISY_RECORDS = PressMotion(duration=1.0), 36
# Mean error on the quiet records: that of the paper's filters is 7 % and 10 % at most, of the others below 0.1 %.
MAX_ELASTIC_BIAS, MAX_OTHER_BIAS = 0.09, 0.2
# Stated standard deviation over the Cramer-Rao bound: 0.7 to 30 for all shipped estimators.
MIN_STD, MAX_STD = 1 / 3, 10.0
MAX_BOUND = 0.05  # Cramer-Rao bound over a parameter's value, up to which a record determines it
CAUTIOUS = 0.3  # errors over stated standard deviations, rms, below which a large one is overstated
MIN_NIS, MAX_NIS = 0.02, 20.0  # of the noisy records; 0.6 to 2.8 for all shipped estimators
NEGATIVE = 2.0  # standard deviations below zero
HEAVY, HEAVY_MASS = PressMotion(frequency=4.0, noise=0.05, rate=500.0), 0.5  # [kg], inertia of 0.3 N
MIN_INERTIA = 0.05  # of a parameter's value, below which its shift by inertia does not show the sign
# Shift by inertia of an estimator that knows the mass, over that of one that neglects it; 1.8 with the wrong sign.
MAX_INERTIA = 1.4


def check_truth(estimator: Estimator, model: ContactModel, theta: Sequence[float]) -> None:
    """Check that an estimator finds parameters around `theta` and knows how well.

    Checked: no bias on quiet records, whose filter's state has no noise of its own; no viscosity below 0 by more than
    two standard deviations; on noisy ones a standard deviation that is not below the Cramer-Rao bound, nor far above it
    and the errors; a NIS of the order of 1; inertia of the tip with its sign. An estimator that has no number on any of
    these records, which begin in contact, is not judged. Raises AssertionError with the reason.
    """
    name = type(estimator).__name__
    quiet = estimate_records(estimator, model, theta, QUIET, QUIET_RECORDS)
    if np.isnan(quiet.values).all():  # an estimator for other motions, which says so by its status
        return
    _check_bias(quiet, model, name)
    noisy = estimate_records(estimator, model, theta, NOISY, NOISY_RECORDS)
    _check_uncertainty(noisy, model, name)
    if np.isfinite(noisy.nis).any():
        nis = float(np.nanmedian(noisy.nis))
        demand(MIN_NIS <= nis <= MAX_NIS, f"{name}: the NIS is {nis:.3g} where it is 1 for the right noise")
    _check_inertia(estimator, model, theta, name)


def _check_bias(errors: Errors, model: ContactModel, name: str) -> None:
    """Compare the values (n, k) of quiet records with the truth; a viscosity may be 0 within its uncertainty."""
    demand(np.isfinite(errors.values).all(), f"{name} has no number at the end of a record of {QUIET.duration:g} s")
    bias = errors.relative.mean(axis=0)
    for index, parameter in enumerate(model.parameters):
        if not _is_determined(errors, index):
            continue
        is_negative = errors.values[:, index] < -NEGATIVE * errors.std[:, index]
        demand(not is_negative.any(), f"{name}: {parameter.name} is below 0 by more than {NEGATIVE:g} of its std")
        allowed = MAX_ELASTIC_BIAS if parameter.role == "elastic" else MAX_OTHER_BIAS
        demand(
            abs(bias[index]) <= allowed,
            f"{name}: {parameter.name} is off by {bias[index]:+.1%} on records almost without noise, allowed "
            f"{allowed:.0%}",
        )


def _is_determined(errors: Errors, index: int) -> bool:
    """Return True where the bound of a parameter is below `MAX_BOUND` of its value on every record."""
    return bool((errors.bound[:, index] < MAX_BOUND * np.abs(errors.truth[:, index])).all())


def _check_uncertainty(errors: Errors, model: ContactModel, name: str) -> None:
    """Compare the stated standard deviations (n, k) with the Cramer-Rao bound and with the errors."""
    for index, parameter in enumerate(model.parameters):
        is_number = np.isfinite(errors.std[:, index]) & np.isfinite(errors.bound[:, index])
        if not is_number.any() or not _is_determined(errors, index):
            continue
        ratio = float(np.median(errors.std[is_number, index] / errors.bound[is_number, index]))
        error = float(np.sqrt(np.mean(errors.standardized[is_number, index] ** 2)))
        demand(
            ratio >= MIN_STD,
            f"{name}: the std of {parameter.name} is {ratio:.2g} of the Cramer-Rao bound, which nothing is below",
        )
        demand(
            ratio <= MAX_STD or error >= CAUTIOUS,
            f"{name}: the std of {parameter.name} is {ratio:.3g} times the Cramer-Rao bound, and {1 / error:.3g} times "
            "its errors",
        )


def _check_inertia(estimator: Estimator, model: ContactModel, theta: Sequence[float], name: str) -> None:
    """Check the sign of m z'' by a heavy tip: its inertia shifts parameters less if the mass is known than if not."""

    def last_values(mass: float, stated_mass: float) -> Floats:
        """Return the last estimates (k,) under a tip of a mass [kg] that the estimator takes for another one."""
        samples = HEAVY.samples(model, theta, mass, seed=1)
        values: Floats = estimator.start(Problem(model, stated_mass)).run(samples).values[-1]
        return values

    light_values = last_values(TIP_MASS, TIP_MASS)
    shift_known = last_values(HEAVY_MASS, HEAVY_MASS) - light_values
    shift_neglected = last_values(HEAVY_MASS, TIP_MASS) - light_values
    # The sign shows in the parameter that inertia moves most.
    effect = np.abs(shift_neglected / np.array(theta, float))
    index = int(np.argmax(effect))
    if not effect[index] >= MIN_INERTIA:
        return
    share = float(shift_known[index] / shift_neglected[index])
    complaint = f"{share:.2g} of what neglecting it does to {model.parameters[index].name}; has m z'' the right sign?"
    demand(abs(share) <= MAX_INERTIA, f"{name}: with the tip's mass known, inertia makes {complaint}")
