"""Calibrations that need no shake: weight and centre of mass by orientations, a tap, the robot's compliance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from palpate import Floats, LogError
from palpate_engine import GRAVITY
from palpate_kit.numerics.normal_equations import linear_regression

from palpate_calibration.calibrated_value import RepeatValue

# Choices.
_SMOOTHED_READINGS = 21  # of the position, by a cubic
_CORRELATION_TIME = 0.1  # [s] of a residual
_TOUCH_SHARE = 0.2  # of the largest force, above which the tip touches
_TOUCH_NOISES = 5.0  # times the noise of the force, likewise
_SECOND_DIFFERENCE_VARIANCE = 6.0  # variance of second differences of white noise of variance 1: 1 + 4 + 1
_MIN_TAP_READINGS, _MIN_PRESS_READINGS = 20, 10  # in contact
_DEGREE = 4  # of the force over the position
_UNKNOWNS = 6.0  # of a tap: that polynomial, and the delay
_MAX_DELAY, _DELAYS = 0.05, 201  # [s] to either side, and the number of delays that are tried
_DELAY_STEP = 2e-4  # [s] for a slope
_MIN_FORCE_CHANGE = 0.5  # [N] of a press
_MIN_SINGULAR_VALUE = 1e-3  # of columns of length 1, below which weight and bias are not distinct
_SMALLEST_NOISE, _SMALLEST_LENGTH = 1e-12, 1e-12  # [N, N m], [m] in quotients, in place of 0


@dataclass(frozen=True)
class WeightFit:
    """The load behind the sensor, by its readings in several orientations."""

    mass: RepeatValue  # [kg]
    centre: Floats  # (3,) [m] centre of mass in the sensor's frame
    centre_std: Floats  # (3,) [m]
    force_bias: Floats  # (3,) [N]
    force_bias_std: Floats  # (3,) [N]
    torque_bias: Floats  # (3,) [N m]
    torque_bias_std: Floats  # (3,) [N m]


def weight_fit(wrenches: Floats, downs: Floats, stds: tuple[float, float]) -> WeightFit:
    """Return mass, centre of mass and bias from mean wrenches (n, 6) [N, N m] at standstill in n >= 3 orientations.

    `downs` (n, 3) is the direction of gravity in the sensor's frame, of length 1; `stds` the standard uncertainty of a
    mean force and of a mean torque. f = m g down + f0 and t = c x (m g down) + t0, both linear, the first solved
    first. Raises LogError where the orientations are too few, or too similar to separate weight from bias.
    """
    count = len(wrenches)
    if count < 3:
        raise LogError(f"calibration: {count} orientations are given; weight and centre of mass need three")

    # Mass and bias of the force: f = m g down + f0, of the unknowns m and f0 (x, y, z).
    design = np.zeros((3 * count, 4))
    design[:, 0] = GRAVITY * downs.ravel()
    design[:, 1:] = np.tile(np.eye(3), (count, 1))
    weight, weight_std = _regression(design, wrenches[:, :3].ravel(), max(stds[0], _SMALLEST_NOISE))
    mass = float(weight[0])

    # Centre and bias of the torque: t = c x (m g down) + t0, of the unknowns c and t0 (x, y, z each).
    torque_design = np.zeros((3 * count, 6))
    for i, down in enumerate(downs * mass * GRAVITY):
        # c x w is linear in c: the matrix of -w x.
        torque_design[3 * i : 3 * i + 3, :3] = [[0, down[2], -down[1]], [-down[2], 0, down[0]], [down[1], -down[0], 0]]
        torque_design[3 * i : 3 * i + 3, 3:] = np.eye(3)
    torque, torque_std = _regression(torque_design, wrenches[:, 3:].ravel(), max(stds[1], _SMALLEST_NOISE))
    # The mass stands in the arms: its share adds to the centre's uncertainty.
    centre_std = np.hypot(torque_std[:3], np.abs(torque[:3]) * weight_std[0] / abs(mass))
    return WeightFit(
        mass=RepeatValue(mass, float(weight_std[0]), freedom=3.0 * count - design.shape[1]),
        centre=torque[:3],
        centre_std=centre_std,
        force_bias=weight[1:],
        force_bias_std=weight_std[1:],
        torque_bias=torque[3:],
        torque_bias_std=torque_std[3:],
    )


def _regression(design: Floats, values: Floats, noise: float) -> tuple[Floats, Floats]:
    """Return unknowns (k,) and their standard errors (k,) by the noise of the values (n,); raises LogError."""
    singular = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    if singular[-1] < _MIN_SINGULAR_VALUE:
        raise LogError(
            "calibration: the orientations are too similar to separate weight from bias; turn the tool by some 30 "
            "degrees or more, about two axes"
        )
    regression = linear_regression(design, values)
    return regression.weights, regression.errors(noise)


def tap_delay(force: tuple[Floats, Floats], position: tuple[Floats, Floats]) -> RepeatValue:
    """Return the delay [s] of the force against the motion, from pressing on a stiff surface and letting go.

    `force` and `position` are time-stamps [s] and readings. On a stiff surface the force is a function of the
    penetration alone, so the loading and unloading branches of force over position coincide at the right delay: the
    delay is where a smooth curve through both leaves the smallest residual. The position is smoothed by cubics over 21
    readings, symmetrically and so without a delay, since its noise times the stiffness is a force; the noisy force is
    never interpolated. The uncertainty takes the residual as correlated over a tenth of a second (Newey and West 1987).
    """
    from scipy.optimize import minimize_scalar

    branches = _TapBranches.of(force, position)  # loading and unloading, where the tip touches
    # The delay of the smallest residual, on a grid and then between its neighbours.
    grid = np.linspace(-_MAX_DELAY, _MAX_DELAY, _DELAYS)
    costs = np.array([branches.cost(delay) for delay in grid])
    best = int(np.argmin(costs))
    if best in (0, len(grid) - 1):
        raise LogError("calibration: the tap shows no delay within 50 ms: the surface is not elastic, or not stiff")
    minimum: Any = minimize_scalar(branches.cost, bounds=(grid[best - 1], grid[best + 1]), method="bounded")
    delay = float(minimum.x)

    # Its uncertainty, by the slope of the residual and its own correlation (Newey and West 1987).
    slope = (branches.residual(delay + _DELAY_STEP) - branches.residual(delay - _DELAY_STEP)) / (2 * _DELAY_STEP)
    count, duration = len(branches.time), float(branches.time[-1] - branches.time[0])
    lags = max(round(_CORRELATION_TIME * count / duration), 1)
    std = math.sqrt(_long_variance(slope * branches.residual(delay), lags)) / float((slope**2).sum())
    return RepeatValue(delay, std, max(count / lags - _UNKNOWNS, 1.0))


@dataclass(frozen=True)
class _TapBranches:
    """The readings of a tap in contact, loading and unloading, and the smooth path of the tip."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N]
    path: Any  # position [m] over time [s], a spline

    @classmethod
    def of(cls, force: tuple[Floats, Floats], position: tuple[Floats, Floats]) -> Self:
        """Return the branches of a record of time-stamps [s] and readings; raises LogError without a tap."""
        times, readings = force
        noise = float(np.sqrt(np.mean(np.diff(readings, 2) ** 2) / _SECOND_DIFFERENCE_VARIANCE))
        touching = readings > max(_TOUCH_SHARE * float(readings.max()), _TOUCH_NOISES * noise)
        if touching.sum() < _MIN_TAP_READINGS:
            raise LogError("calibration: the record contains no tap: the force does not rise for 20 readings")
        from scipy.interpolate import CubicSpline
        from scipy.signal import savgol_filter

        path = CubicSpline(position[0], savgol_filter(position[1], _SMOOTHED_READINGS, 3))
        return cls(times[touching], readings[touching], path)

    def residual(self, delay: float) -> Floats:
        """Return the residual (n,) [N] of the force as a polynomial of the position so much earlier."""
        z = self.path(self.time - delay)
        unit = (z - z.min()) / max(float(np.ptp(z)), _SMALLEST_LENGTH) * 2 - 1  # from -1 to 1
        basis = np.polynomial.chebyshev.chebvander(unit, _DEGREE)
        return np.asarray(self.force - basis @ np.linalg.lstsq(basis, self.force, rcond=None)[0])

    def cost(self, delay: float) -> float:
        """Return the sum of squares [N^2] of the residual."""
        return float((self.residual(delay) ** 2).sum())


def _long_variance(scores: Floats, lags: int) -> float:
    """Return the variance of the sum of correlated scores (n,), by Bartlett's weights; at least as independent."""
    independent = float((scores**2).sum())
    total = independent
    for lag in range(1, min(lags, len(scores) - 1)):
        total += 2.0 * (1.0 - lag / lags) * float((scores[lag:] * scores[:-lag]).sum())
    return max(total, independent)


def series_compliance(force: Floats, position: Floats) -> RepeatValue:
    """Return the compliance dz/dF [m/N] of robot and sensor, from readings (n,) of a press on a rigid plate.

    z = z0 - c F by least squares where the tip presses, with the scatter of z about the line. Raises LogError where
    the force hardly changes.
    """
    pressing = force > _TOUCH_SHARE * force.max()
    u, z = force[pressing], position[pressing]
    if len(u) < _MIN_PRESS_READINGS or np.ptp(u) < _MIN_FORCE_CHANGE:
        raise LogError("calibration: the force on the plate changes by less than 0.5 N: no compliance can be seen")
    regression = linear_regression(np.column_stack([u - u.mean(), np.ones(len(u))]), z)
    return RepeatValue(-float(regression.weights[0]), float(regression.errors()[0]), float(len(u) - 2))
