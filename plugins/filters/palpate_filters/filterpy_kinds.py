"""The filters of filterpy behind one interface, and the process as functions of numbers for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from palpate import Floats

from palpate_filters.inertial_filter import Start
from palpate_filters.predictions import floor_depth
from palpate_filters.process_models import InertialProcess
from palpate_filters.step_limits import MISSING_ABOVE, UNKNOWN_FORCE_STD


class _Expression:
    """An expression of a state, a force and an interval, as a function of numbers, for `count` states in one call."""

    def __init__(self, arguments: Any, expression: Any, count: int = 1) -> None:
        import casadi as ca

        # The function reads and writes these two arrays in place, which spares a conversion in every call.
        self._arguments = np.zeros((count, arguments.numel()))
        self._values = np.zeros((count, expression.numel()))
        self._function = ca.Function("f", [arguments], [ca.densify(expression)]).map(count)
        buffer: Any
        buffer, self._evaluate = self._function.buffer()
        buffer.set_arg(0, memoryview(self._arguments.data))
        buffer.set_res(0, memoryview(self._values.data))
        self._buffer = buffer  # the owner of the memory of an evaluation

    def __call__(self, x: Floats, force: float, interval: float) -> Floats:
        self._arguments[:, :-2] = x
        self._arguments[:, -2] = force
        self._arguments[:, -1] = interval
        self._evaluate()
        return self._values.copy()


class ScaledProcess:
    """The process in units of the first standard deviations."""

    def __init__(self, process: InertialProcess, start: Start, force_std: float, velocity_std: float) -> None:
        """Build the process as functions of numbers; `force_std` [N] and `velocity_std` [m/s] are the noises."""
        import casadi as ca

        self.process, self.start, self.scale = process, start, start.std
        self.force_std = force_std
        self.speed = process.layout.at("rate")  # row of the depth rate, which is measured
        self.variance = (velocity_std / start.std[self.speed]) ** 2  # of a measured rate, scaled
        # The state one interval later, a missing force taken as the model's own, and its Jacobian.
        x, u, interval = ca.SX.sym("x", process.states), ca.SX.sym("u"), ca.SX.sym("T")
        state = ca.vertsplit(x)
        force = ca.if_else(ca.fabs(u) <= MISSING_ABOVE, u, process.force(state))
        ahead = ca.vertcat(*process.predict(state, force, interval))
        slope = ca.substitute(ca.jacobian(ahead, x), x, floor_depth(process, x))
        arguments = ca.vertcat(x, u, interval)
        self._arguments, self._step = arguments, ahead
        self._ahead, self._slope = _Expression(arguments, ahead), _Expression(arguments, ca.vec(slope.T))
        self._force = _Expression(arguments, process.force(state))
        self._shape = (process.states, process.states)

    def ahead(self, x: Floats, interval: float, force: float) -> Floats:
        """Return the state one interval [s] later under a force [N]."""
        state: Floats = self._ahead(x.ravel() * self.scale, force, interval)[0] / self.scale
        return state

    def ahead_of_all(self, count: int) -> Callable[[Floats, float, float], Floats]:
        """Return a function like `ahead` of `count` states (count, n) in one call."""
        step = _Expression(self._arguments, self._step, count)

        def advance(states: Floats, interval: float, force: float) -> Floats:
            return step(states * self.scale, force, interval) / self.scale

        return advance

    def slope(self, x: Floats, interval: float, force: float) -> Floats:
        """Return the Jacobian (n, n) of `ahead`."""
        jacobian = self._slope(x.ravel() * self.scale, force, interval).reshape(self._shape)
        return jacobian * self.scale / self.scale[:, None]

    def reading(self, x: Floats) -> Floats:
        """Return the measurement (1,) in a state: its rate."""
        return x[self.speed : self.speed + 1]

    def force(self, x: Floats) -> float:
        """Return the contact force [N] in a state."""
        return float(self._force(x.ravel() * self.scale, 0.0, 0.0).item())

    def gain(self, interval: float) -> Floats:
        """Return what 1 N over an interval [s] adds to the state (n,)."""
        gain = np.zeros(len(self.scale))
        gain[self.process.layout.span("depth", "rate")] = self.process.gain(interval)
        return gain / self.scale

    def noise_std(self, force: float) -> float:
        """Return the standard deviation [N] of a force; a missing one has `UNKNOWN_FORCE_STD`."""
        return self.force_std if np.isfinite(force) else UNKNOWN_FORCE_STD

    def noise(self, interval: float, force: float) -> Floats:
        """Return the process noise (n, n) over an interval [s]."""
        gain = self.gain(interval)
        return np.outer(gain, gain) * self.noise_std(force) ** 2


class Filter(Protocol):
    """A filter of any kind: mean (n,) and covariance (n, n) in scaled units, and two steps."""

    def get(self) -> tuple[Floats, Floats]:
        """Return mean and covariance."""
        ...

    def put(self, mean: Floats, covariance: Floats) -> None:
        """Set mean and covariance."""
        ...

    def predict(self, interval: float, force: float) -> None:
        """Advance by one interval [s] under a force [N]."""
        ...

    def update(self, rate: float) -> None:
        """Update with a rate, in units of its first standard deviation."""
        ...


def extended_filter(rig: ScaledProcess) -> Filter:
    """Return filterpy's extended Kalman filter."""
    return _ExtendedKind(rig)


def ensemble(rig: ScaledProcess, members: int, seed: int) -> Filter:
    """Return an ensemble Kalman filter."""
    return _Ensemble(rig, members, seed)


class _ExtendedKind:
    """filterpy.kalman.ExtendedKalmanFilter."""

    def __init__(self, rig: ScaledProcess) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        self._rig, n = rig, rig.process.states
        self._filter = ExtendedKalmanFilter(n, 1)
        self._filter.R = np.array([[rig.variance]])
        self._row = rig.reading(np.eye(n))

    def get(self) -> tuple[Floats, Floats]:
        return self._filter.x.ravel(), self._filter.P

    def put(self, mean: Floats, covariance: Floats) -> None:
        self._filter.x, self._filter.P = mean.reshape(-1, 1), covariance

    def predict(self, interval: float, force: float) -> None:
        before = self._filter.x
        self._filter.F = self._rig.slope(before, interval, force)
        self._filter.Q = self._rig.noise(interval, force)
        self._filter.predict()
        self._filter.x = self._rig.ahead(before, interval, force).reshape(-1, 1)

    def update(self, rate: float) -> None:
        self._filter.update(np.array([[rate]]), lambda x: self._row, self._rig.reading)


def sigma_point_filter(rig: ScaledProcess, kind: Any, **extra: Any) -> Filter:
    """Return filterpy's unscented or cubature Kalman filter."""
    n = rig.process.states
    filter_ = kind(dim_x=n, dim_z=1, dt=1.0, hx=rig.reading, fx=rig.ahead, **extra)
    filter_.R = np.array([[rig.variance]])
    return _SigmaPointKind(rig, filter_, cubature="points" not in extra)


class _SigmaPointKind:
    """filterpy.kalman.UnscentedKalmanFilter and CubatureKalmanFilter."""

    def __init__(self, rig: ScaledProcess, filter_: Any, cubature: bool) -> None:
        self._rig, self._filter, self._cubature = rig, filter_, cubature
        self._drawn = False

    def get(self) -> tuple[Floats, Floats]:
        return np.asarray(self._filter.x, float).ravel(), np.asarray(self._filter.P, float)

    def put(self, mean: Floats, covariance: Floats) -> None:
        self._filter.x = mean.reshape(-1, 1) if self._cubature else mean
        self._filter.P = covariance
        self._filter.Q = np.zeros_like(covariance)
        self._advance(0.0, 0.0)  # draws sigma points, and moves nothing

    def predict(self, interval: float, force: float) -> None:
        self._filter.Q = self._rig.noise(interval, force)
        self._advance(interval, force)

    def _advance(self, interval: float, force: float) -> None:
        if self._cubature:
            self._filter.predict(dt=interval, fx_args=(force,))
        else:
            self._filter.predict(dt=interval, force=force)

    def update(self, rate: float) -> None:
        self._filter.update(np.array([[rate]]) if self._cubature else np.array([rate]))


class _Ensemble:
    """The ensemble Kalman filter with perturbed measurements (Burgers 1998), each step for all members in one call.

    The equations are those of filterpy.kalman.EnsembleKalmanFilter, which goes through its members one by one and
    draws from numpy's global generator.
    """

    def __init__(self, rig: ScaledProcess, members: int, seed: int) -> None:
        self._rig, self._count = rig, members
        self._random = np.random.default_rng(seed)
        self._advance = rig.ahead_of_all(members)
        self._members = np.zeros((members, rig.process.states))
        self._mean = np.zeros(rig.process.states)
        self._covariance = np.eye(rig.process.states)

    def get(self) -> tuple[Floats, Floats]:
        return self._mean, self._covariance

    def put(self, mean: Floats, covariance: Floats) -> None:
        self._mean, self._covariance = mean, covariance
        self._members = self._random.multivariate_normal(mean, covariance, self._count)

    def predict(self, interval: float, force: float) -> None:
        # Each member has its own error of the force.
        errors = self._rig.noise_std(force) * self._random.standard_normal(self._count)
        self._members = self._advance(self._members, interval, force) + np.outer(errors, self._rig.gain(interval))
        # Mean and covariance are those of the members.
        self._mean = self._members.mean(axis=0)
        deviations = self._members - self._mean
        self._covariance = deviations.T @ deviations / (self._count - 1)

    def update(self, rate: float) -> None:
        # Gain K = P_xz / S from the covariance of the members with their own measurements.
        predictions = self._members[:, self._rig.speed]
        deviations = predictions - predictions.mean()
        innovation_variance = deviations @ deviations / (self._count - 1) + self._rig.variance
        gain = deviations @ (self._members - self._mean) / (self._count - 1) / innovation_variance
        # Each member moves by its own perturbed measurement; P = P - K S K'.
        errors = np.sqrt(self._rig.variance) * self._random.standard_normal(self._count)
        self._members = self._members + np.outer(rate + errors - predictions, gain)
        self._mean = self._members.mean(axis=0)
        self._covariance = self._covariance - innovation_variance * np.outer(gain, gain)
