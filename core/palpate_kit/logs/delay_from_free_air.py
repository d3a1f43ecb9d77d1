"""The delay between force and motion, determined in free air: the load on the sensor follows its acceleration at once.

Without contact F = c - m a(t - tau): regressed on c, a and its derivative j, F = c - m a + m tau j. The standard
deviation is that of the residual's own autocorrelation.
"""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_kit.logs import role_evidence as evidence
from palpate_kit.numerics.normal_equations import linear_regression

_SMOOTH = 5  # samples to either side of what is differentiated
_LEAST = 200  # samples in air
_STRETCHES = 20  # of the air, whose scores are independent
_SURE = 6.0  # standard deviations by which the mass must be determined
_MASS = (0.005, 5.0)  # [kg] of what can hang behind a sensor
_SWING = 0.05  # of the force's range that may be inertia
_SHARE = 0.05  # of the record that must be in free air
_MOST = 0.02  # [s] of standard deviation beyond which nothing is said


def air_delay(
    force_time: Floats, force: Floats, position_time: Floats, position: Floats
) -> tuple[float, float, float] | None:
    """Return how much later [s] the force is recorded than the motion, its standard deviation, and the mass [kg].

    Force is positive in contact, position upwards. None where nothing moves in free air, or not enough.
    """
    grid, (force, position) = evidence.on_grid([force_time, position_time], [force, position])
    step = float(grid[1] - grid[0])
    low, high = (float(x) for x in np.percentile(force, (0.5, 99.8)))
    reach = force < low + _SWING * (high - low)  # it may swing, but does not push
    if step <= 0 or reach.mean() < _SHARE:
        return None
    air = position > position[~reach].max(initial=-np.inf)  # above wherever it pushed
    smooth = position
    for _ in range(3):
        smooth = np.convolve(smooth - smooth[0], np.ones(2 * _SMOOTH + 1) / (2 * _SMOOTH + 1), "same") + smooth[0]
    acceleration = np.gradient(np.gradient(smooth, step), step)
    jerk = np.gradient(acceleration, step)
    answer = force
    for _ in range(3):
        answer = np.convolve(answer - answer[0], np.ones(2 * _SMOOTH + 1) / (2 * _SMOOTH + 1), "same") + answer[0]
    edge = 8 * _SMOOTH
    usable = air.copy()
    usable[:edge] = usable[-edge:] = False
    for shift in range(1, edge):
        usable[:-shift] &= air[shift:]
        usable[shift:] &= air[:-shift]
    if usable.sum() < _LEAST:
        return None
    return _regressed(answer[usable], acceleration[usable], jerk[usable])


def _regressed(force: Floats, acceleration: Floats, jerk: Floats) -> tuple[float, float, float] | None:
    terms = np.column_stack([np.ones(len(force)), acceleration, jerk])
    regression = linear_regression(terms, force)
    # Neighbours are correlated: the covariance is that of the scores of stretches (Huber 1967).
    parts = np.array_split(np.arange(len(force)), _STRETCHES)
    scores = np.array([terms[part].T @ regression.residual[part] for part in parts])
    covariance = regression.inverse @ (scores.T @ scores) @ regression.inverse * len(parts) / (len(parts) - 1)
    mass, pull = -regression.weights[1], regression.weights[2]
    if not (_MASS[0] < mass < _MASS[1] and mass > _SURE * covariance[1, 1] ** 0.5):
        return None
    delay = pull / mass
    slope = np.array([0.0, delay / mass, 1.0 / mass])
    std = float(np.sqrt(slope @ covariance @ slope))
    return (float(delay), std, float(mass)) if std < _MOST else None
