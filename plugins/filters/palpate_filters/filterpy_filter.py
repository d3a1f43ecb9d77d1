"""Any of filterpy's filters on the paper's process: for comparison, and for filters that are not compiled here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from palpate import (
    Belief,
    ConfigurationError,
    InertialProcess,
    Moment,
    Problem,
    Status,
    Tracker,
    track_by_step,
)
from pydantic import Field

from palpate_filters.inertial_filter import PaperStart, Start, first_state, mass_of
from palpate_filters.predictions import Points, away
from palpate_filters.tracking import PAUSE

Floats = NDArray[np.float64]

_BLIND_STD = 1.0  # [N], how little is known of a force that is missing
_RESUME_STD = 1e-4  # [m]


class FilterpyFilter(PaperStart):
    """A filter of the filterpy library (Labbe 2015) on the paper's process and measurement.

    Some 500 times slower than the compiled filters here. The state is scaled by its first standard deviations, since
    some of filterpy's filters compare covariances with absolute numbers. Where filterpy gives up, such as on a
    covariance that is not positive, the track ends as diverged.
    """

    filter: Literal["ekf", "ukf", "ckf", "enkf"] = Field(
        default="ukf", description="extended, unscented, cubature, or ensemble Kalman filter"
    )
    points: Points = Field(default="merwe", description="kind of sigma points (ukf)")
    spread: float = Field(default=1e-3, gt=0, le=10, description="alpha of the sigma points (ukf, merwe)")
    beta: float = Field(default=2.0, allow_inf_nan=False, description="beta of the sigma points (ukf, merwe)")
    kappa: float = Field(default=0.0, gt=-2, allow_inf_nan=False, description="kappa of the sigma points (ukf)")
    members: int = Field(default=100, ge=2, description="size of the ensemble (enkf)")
    seed: int = Field(default=0, ge=0, description="seed of the ensemble (enkf)")

    @property
    def declared_noise(self) -> tuple[float, float] | None:
        """See `palpate.Estimator`."""
        return self.force_std, self.velocity_std

    def start(self, problem: Problem) -> Tracker:
        """A tracker; raises ConfigurationError where filterpy, the tip's mass or a first guess is missing."""
        try:
            import filterpy.kalman
        except ImportError as error:
            raise ConfigurationError(f"filterpy cannot be imported ({error}); pip install filterpy") from error
        process = InertialProcess(problem.model, mass_of(problem))
        start = first_state(self, process)
        rig = _Rig(process, start, self.force_std, self.velocity_std)
        makers: dict[str, Callable[[], _Filter]] = {
            "ekf": lambda: _Extended(rig),
            "ukf": lambda: _sampled(rig, filterpy.kalman.UnscentedKalmanFilter, points=self._points(process.states)),
            "ckf": lambda: _sampled(rig, filterpy.kalman.CubatureKalmanFilter),
            "enkf": lambda: _Ensemble(rig, self.members, self.seed),
        }
        return track_by_step(len(problem.model.parameters), _Stepper(rig, makers[self.filter]))

    def _points(self, states: int) -> Any:
        from filterpy.kalman import JulierSigmaPoints, MerweScaledSigmaPoints, SimplexSigmaPoints

        if self.points == "merwe":
            return MerweScaledSigmaPoints(states, self.spread, self.beta, self.kappa)
        return JulierSigmaPoints(states, self.kappa) if self.points == "julier" else SimplexSigmaPoints(states)


class _Evaluated:
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


class _Rig:
    """The process in units of the first standard deviations."""

    def __init__(self, process: InertialProcess, start: Start, force_std: float, velocity_std: float) -> None:
        import casadi as ca

        self.process, self.start, self.scale = process, start, start.std
        self.force_std = force_std
        self.variance = (velocity_std / start.std[1]) ** 2
        x, u, t = ca.SX.sym("x", process.states), ca.SX.sym("u"), ca.SX.sym("T")
        state = ca.vertsplit(x)
        driven = ca.if_else(ca.fabs(u) <= 1e300, u, process.force(state))
        ahead = ca.vertcat(*process.predict(state, driven, t))
        slope = ca.substitute(ca.jacobian(ahead, x), x, ca.vertcat(away(x[0]), x[1:]))
        given, n = ca.vertcat(x, u, t), process.states
        self._ahead, self._slope = _Evaluated(given, ahead), _Evaluated(given, ca.vec(slope.T))
        self._force = _Evaluated(given, process.force(state))
        self._shape = (n, n)

    def ahead(self, x: Floats, interval: float, force: float) -> Floats:
        """The state one interval [s] later under a force [N]."""
        return self._ahead(x.ravel() * self.scale, force, interval) / self.scale

    def slope(self, x: Floats, interval: float, force: float) -> Floats:
        """The Jacobian (n, n) of `ahead`."""
        found = self._slope(x.ravel() * self.scale, force, interval).reshape(self._shape)
        return found * self.scale / self.scale[:, None]

    def force(self, x: Floats) -> float:
        """Contact force [N] in a state."""
        return float(self._force(x.ravel() * self.scale, 0.0, 0.0)[0])

    def noise(self, interval: float, force: float) -> Floats:
        """Process noise (n, n)."""
        gain = np.zeros(len(self.scale))
        gain[:2] = self.process.gain(interval)
        std = self.force_std if np.isfinite(force) else _BLIND_STD
        return np.outer(gain / self.scale, gain / self.scale) * std**2


class _Filter(Protocol):
    """What is asked of a filter, whichever it is: mean (n,) and covariance (n, n) in scaled units, and two steps."""

    def get(self) -> tuple[Floats, Floats]: ...
    def put(self, mean: Floats, covariance: Floats) -> None: ...
    def predict(self, interval: float, force: float) -> None: ...
    def update(self, rate: float) -> None: ...


class _Stepper:
    """The step function of the track."""

    def __init__(self, rig: _Rig, make: Callable[[], _Filter]) -> None:
        self._rig, self._filter = rig, make()
        self._force = np.nan
        self._surface = np.nan
        self._begun = self._lost = False

    def __call__(self, moment: Moment) -> Belief:
        if not self._lost:
            try:
                return self._step(moment)
            except (np.linalg.LinAlgError, ValueError, FloatingPointError):
                self._lost = True
        nothing = np.full(len(self._rig.process.model.parameters), np.nan)
        return Belief(nothing, nothing, np.nan, np.nan, np.nan, status=int(Status.DIVERGED))

    def _step(self, moment: Moment) -> Belief:
        status = Status(0)
        if moment.first or moment.interval > PAUSE:
            status |= self._begin(moment)
        else:
            self._filter.predict(moment.interval, self._force)
            status |= Status(0) if np.isfinite(self._force) else Status.BLIND
        rig, (mean, covariance) = self._rig, self._filter.get()
        nis = np.nan
        if np.isfinite(moment.velocity):
            rate = -moment.velocity / rig.scale[1]
            nis = float((rate - mean[1]) ** 2 / (covariance[1, 1] + rig.variance))
            self._filter.update(rate)
        else:
            status |= Status.BLIND
        self._force = moment.force
        mean, covariance = self._filter.get()
        variance = np.diag(covariance)
        if not (np.isfinite(mean).all() and (variance >= 0).all() and abs(mean[0] * rig.scale[0]) < 0.1):
            raise FloatingPointError
        values, std = mean * rig.scale, np.sqrt(variance) * rig.scale
        self._surface = moment.position + values[0]
        where = rig.process.parameters
        status |= Status.LIFTED if values[0] <= 0 else Status(0)
        return Belief(values[where], std[where], float(values[0]), float(std[0]), rig.force(mean), nis, int(status))

    def _begin(self, moment: Moment) -> Status:
        rig, depth = self._rig, self._surface - moment.position
        resumed = self._begun and depth > 0
        mean, covariance = rig.start.mean / rig.scale, np.eye(len(rig.scale))
        if resumed:
            before, spread = self._filter.get()
            mean[2:], covariance[2:, 2:] = before[2:], spread[2:, 2:]
            mean[0] = depth / rig.scale[0]
            covariance[0, 0] = spread[0, 0] + (_RESUME_STD / rig.scale[0]) ** 2
        mean[1] = -moment.velocity / rig.scale[1] if np.isfinite(moment.velocity) else 0.0
        self._filter.put(mean, covariance)
        self._begun = True
        return Status.RESUMED if resumed else Status(0)


class _Extended:
    """filterpy.kalman.ExtendedKalmanFilter."""

    def __init__(self, rig: _Rig) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        self._rig, n = rig, rig.process.states
        self._filter = ExtendedKalmanFilter(n, 1)
        self._filter.R = np.array([[rig.variance]])
        self._row = np.eye(n)[1:2]

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
        self._filter.update(np.array([[rate]]), lambda x: self._row, lambda x: x[1:2])


def _sampled(rig: _Rig, kind: Any, **extra: Any) -> _Filter:
    n = rig.process.states
    filter_ = kind(dim_x=n, dim_z=1, dt=1.0, hx=lambda x: x[1:2], fx=rig.ahead, **extra)
    filter_.R = np.array([[rig.variance]])
    return _Sampled(rig, filter_, cubature="points" not in extra)


class _Sampled:
    """filterpy.kalman.UnscentedKalmanFilter and CubatureKalmanFilter."""

    def __init__(self, rig: _Rig, filter_: Any, cubature: bool) -> None:
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

    def __init__(self, rig: _Rig, members: int, seed: int) -> None:
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
                x=mean, P=covariance, dim_z=1, dt=1.0, N=self._members, hx=lambda x: x[1:2], fx=self._ahead
            )

        self._filter = self._own_dice(make)
        self._filter.R = np.array([[self._rig.variance]])

    def predict(self, interval: float, force: float) -> None:
        self._interval, self._force = interval, force
        self._filter.Q = self._rig.noise(interval, force)
        self._own_dice(self._filter.predict)

    def update(self, rate: float) -> None:
        self._own_dice(lambda: self._filter.update(np.array([rate])))
