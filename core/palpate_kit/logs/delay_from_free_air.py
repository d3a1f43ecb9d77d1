"""The delay between force and motion, determined in free air: the load on the sensor follows its acceleration at once.

Without contact F = c - m a(t - tau): regressed on c, a and its derivative j, F = c - m a + m tau j. The standard
deviation is by the scores of stretches of the record, since neighbours are correlated.
"""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_kit.logs import role_evidence as evidence
from palpate_kit.numerics.normal_equations import linear_regression

# Choices.
_SMOOTH_SAMPLES = 5  # to either side, of each of three moving averages
_EDGE_SAMPLES = 8 * _SMOOTH_SAMPLES  # to either side that averages and derivatives depend on, with some to spare
_MIN_AIR_SAMPLES = 200
_MIN_AIR_SHARE = 0.05  # of the record
_STRETCHES = 20  # of the air, whose scores are independent
_MASS_SIGMAS = 6.0  # by which the mass must differ from 0
_MIN_MASS, _MAX_MASS = 0.005, 5.0  # [kg] behind a sensor
_INERTIA_SHARE = 0.05  # of the force's range that may be inertia
_LOW_PERCENTILE, _HIGH_PERCENTILE = 0.5, 99.8  # [%] of the forces, which are their range without spikes
_MAX_STD = 0.02  # [s] of a delay, beyond which None is returned


def air_delay(
    force_time: Floats, force: Floats, position_time: Floats, position: Floats
) -> tuple[float, float, float] | None:
    """Return the delay [s] of the force behind the motion, its standard deviation [s], and the mass [kg].

    Force is positive in contact, position upwards, with times [s] of their own. By regression of the force on the tip's
    acceleration and jerk in free air. None if too little of the record is motion in free air.
    """
    grid, (force, position) = evidence.on_grid([force_time, position_time], [force, position])
    step = float(grid[1] - grid[0])
    # In free air the force may swing, but not push; and the tip is above all places at which it pushes.
    low, high = (float(x) for x in np.percentile(force, (_LOW_PERCENTILE, _HIGH_PERCENTILE)))
    without_push = force < low + _INERTIA_SHARE * (high - low)
    if step <= 0 or without_push.mean() < _MIN_AIR_SHARE:
        return None
    in_air = position > position[~without_push].max(initial=-np.inf)
    # Force and motion get the same averages, so that the delay between them stays.
    acceleration = np.gradient(np.gradient(_averaged(position), step), step)
    jerk = np.gradient(acceleration, step)
    averaged_force = _averaged(force)
    # A sample is usable if all samples that its averages and derivatives depend on are in air.
    is_usable = in_air.copy()
    is_usable[:_EDGE_SAMPLES] = is_usable[-_EDGE_SAMPLES:] = False
    for shift in range(1, _EDGE_SAMPLES):
        is_usable[:-shift] &= in_air[shift:]
        is_usable[shift:] &= in_air[:-shift]
    if is_usable.sum() < _MIN_AIR_SAMPLES:
        return None
    return _delay_by_regression(averaged_force[is_usable], acceleration[is_usable], jerk[is_usable])


def _averaged(values: Floats) -> Floats:
    """Return values (n,) after three moving averages over 11 samples."""
    width = 2 * _SMOOTH_SAMPLES + 1
    for _ in range(3):
        values = np.asarray(np.convolve(values - values[0], np.ones(width) / width, "same") + values[0])
    return values


def _delay_by_regression(force: Floats, acceleration: Floats, jerk: Floats) -> tuple[float, float, float] | None:
    """Return delay [s], its standard deviation and mass [kg] by F = c - m a + m tau j; None if they are not determined.

    With p = m tau the slope of tau = p/m in (c, -m, p) is (0, tau/m, 1/m), by which the covariance propagates.
    """
    terms = np.column_stack([np.ones(len(force)), acceleration, jerk])
    regression = linear_regression(terms, force)
    # Neighbours are correlated: the covariance is that of the scores of stretches (Huber 1967).
    parts = np.array_split(np.arange(len(force)), _STRETCHES)
    scores = np.array([terms[part].T @ regression.residual[part] for part in parts])
    covariance = regression.inverse @ (scores.T @ scores) @ regression.inverse * len(parts) / (len(parts) - 1)
    mass, mass_times_delay = -regression.weights[1], regression.weights[2]
    if not (_MIN_MASS < mass < _MAX_MASS and mass > _MASS_SIGMAS * covariance[1, 1] ** 0.5):
        return None
    delay = mass_times_delay / mass
    slope = np.array([0.0, delay / mass, 1.0 / mass])
    std = float(np.sqrt(slope @ covariance @ slope))
    return (float(delay), std, float(mass)) if std < _MAX_STD else None
