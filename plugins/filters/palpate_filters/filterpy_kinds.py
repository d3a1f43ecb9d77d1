"""The filters of filterpy behind one face, and the process as they want it: numbers in, numbers out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from palpate import Floats

from palpate_filters.inertial_filter import Start
from palpate_filters.predictions import away
from palpate_filters.process_models import InertialProcess

_BLIND_STD = 1.0  # [N], how little is known of a force that is missing


class _Expression:
    """An expression of a state, a force and an interval, as a function of numbers."""

    def __init__(self, given: Any, expression: Any) -> None:
        import casadi as ca

        self._given, self._found = np.zeros(given.numel()), np.zeros(expression.numel())
        self._function = ca.Function("f", [given], [ca.densify(expression)])
        buffer: Any
        buffer, self._evaluate = self._function.buffer()
        buffer.set_arg(0, memoryview(self._given.data))
        buffer.set_res(0, memoryview(self._found.data))
        self._buffer = buffer  # it owns what the evaluation uses

    def __call__(self, x: Floats, force: float, interval: float) -> Floats:
        self._given[:-2], self._given[-2], self._given[-1] = x, force, interval
        self._evaluate()
        return self._found.copy()


class ScaledProcess:
    """The process in units of the first standard deviations."""

    def __init__(self, process: InertialProcess, start: Start, force_std: float, velocity_std: float) -> None:
        import casadi as ca

        self.process, self.start, self.scale = process, start, start.std
        self.force_std = force_std
        self.speed = process.layout.at("rate")
        self.variance = (velocity_std / start.std[self.speed]) ** 2
        x, u, t = ca.SX.sym("x", process.states), ca.SX.sym("u"), ca.SX.sym("T")
        state = ca.vertsplit(x)
        driven = ca.if_else(ca.fabs(u) <= 1e300, u, process.force(state))
        ahead = ca.vertcat(*process.predict(state, driven, t))
        slope = ca.substitute(ca.jacobian(ahead, x), x, away(process, x))
        given, n = ca.vertcat(x, u, t), process.states
        self._ahead, self._slope = _Expression(given, ahead), _Expression(given, ca.vec(slope.T))
        self._force = _Expression(given, process.force(state))
        self._shape = (n, n)

    def ahead(self, x: Floats, interval: float, force: float) -> Floats:
        """The state one interval [s] later under a force [N]."""
        return self._ahead(x.ravel() * self.scale, force, interval) / self.scale

    def slope(self, x: Floats, interval: float, force: float) -> Floats:
        """The Jacobian (n, n) of `ahead`."""
        found = self._slope(x.ravel() * self.scale, force, interval).reshape(self._shape)
        return found * self.scale / self.scale[:, None]

    def reading(self, x: Floats) -> Floats:
        """What is measured (1,) in a state: its rate."""
        return x[self.speed : self.speed + 1]

    def force(self, x: Floats) -> float:
        """Contact force [N] in a state."""
        return float(self._force(x.ravel() * self.scale, 0.0, 0.0).item())

    def noise(self, interval: float, force: float) -> Floats:
        """Process noise (n, n)."""
        gain = np.zeros(len(self.scale))
        gain[self.process.layout.span("depth", "rate")] = self.process.gain(interval)
        std = self.force_std if np.isfinite(force) else _BLIND_STD
        return np.outer(gain / self.scale, gain / self.scale) * std**2


class Filter(Protocol):
    """What is asked of a filter, whichever it is: mean (n,) and covariance (n, n) in scaled units, and two steps."""

    def get(self) -> tuple[Floats, Floats]:
        """Mean and covariance."""
        ...

    def put(self, mean: Floats, covariance: Floats) -> None:
        """Begin with these."""
        ...

    def predict(self, interval: float, force: float) -> None:
        """One interval [s] ahead under a force [N]."""
        ...

    def update(self, rate: float) -> None:
        """Take in a rate, in units of its first standard deviation."""
        ...


def extended_filter(rig: ScaledProcess) -> Filter:
    """filterpy's extended Kalman filter."""
    return _ExtendedKind(rig)


def ensemble(rig: ScaledProcess, members: int, seed: int) -> Filter:
    """filterpy's ensemble Kalman filter."""
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
    """filterpy's unscented or cubature Kalman filter."""
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
    """filterpy.kalman.EnsembleKalmanFilter, which plays dice with numpy's global generator."""

    def __init__(self, rig: ScaledProcess, members: int, seed: int) -> None:
        self._rig, self._members = rig, members
        self._dice = np.random.RandomState(seed).get_state()
        self._interval, self._force = 0.0, 0.0
        self._filter: Any = None

    def _own_dice(self, roll: Callable[[], Any]) -> Any:
        theirs = np.random.get_state()
        np.random.set_state(self._dice)
        try:
            return roll()
        finally:
            self._dice = np.random.get_state()
            np.random.set_state(theirs)

    def _ahead(self, x: Floats, _: float) -> Floats:
        return self._rig.ahead(x, self._interval, self._force)

    def get(self) -> tuple[Floats, Floats]:
        return self._filter.x, self._filter.P

    def put(self, mean: Floats, covariance: Floats) -> None:
        from filterpy.kalman import EnsembleKalmanFilter

        def make() -> Any:
            return EnsembleKalmanFilter(
                x=mean, P=covariance, dim_z=1, dt=1.0, N=self._members, hx=self._rig.reading, fx=self._ahead
            )

        self._filter = self._own_dice(make)
        self._filter.R = np.array([[self._rig.variance]])

    def predict(self, interval: float, force: float) -> None:
        self._interval, self._force = interval, force
        self._filter.Q = self._rig.noise(interval, force)
        self._own_dice(self._filter.predict)

    def update(self, rate: float) -> None:
        self._own_dice(lambda: self._filter.update(np.array([rate])))
