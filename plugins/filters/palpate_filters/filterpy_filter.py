"""Any of filterpy's filters on the paper's process: for comparison, and for filters that are not compiled here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from palpate import Belief, ConfigurationError, Moment, Problem, Status, Tracker, track_by_step
from pydantic import Field

from palpate_filters.filterpy_kinds import Filter, ScaledProcess, ensemble, extended_filter, sigma_point_filter
from palpate_filters.inertial_filter import PaperStart, first_state, moved_mass
from palpate_filters.predictions import Points
from palpate_filters.process_models import InertialProcess
from palpate_filters.starting_fit import PAUSE

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
        process = InertialProcess(problem.model, moved_mass(problem))
        start = first_state(self, process, problem)
        rig = ScaledProcess(process, start, self.force_std, self.velocity_std)
        makers: dict[str, Callable[[], Filter]] = {
            "ekf": lambda: extended_filter(rig),
            "ukf": lambda: sigma_point_filter(
                rig, filterpy.kalman.UnscentedKalmanFilter, points=self._points(process.states)
            ),
            "ckf": lambda: sigma_point_filter(rig, filterpy.kalman.CubatureKalmanFilter),
            "enkf": lambda: ensemble(rig, self.members, self.seed),
        }
        return track_by_step(len(problem.model.parameters), _Stepper(rig, makers[self.filter]))

    def _points(self, states: int) -> Any:
        from filterpy.kalman import JulierSigmaPoints, MerweScaledSigmaPoints, SimplexSigmaPoints

        if self.points == "merwe":
            return MerweScaledSigmaPoints(states, self.spread, self.beta, self.kappa)
        return JulierSigmaPoints(states, self.kappa) if self.points == "julier" else SimplexSigmaPoints(states)


class _Stepper:
    """The step function of the track."""

    def __init__(self, rig: ScaledProcess, make: Callable[[], Filter]) -> None:
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
        depth, speed = rig.process.layout.at("depth"), rig.speed
        innovation = np.nan
        if np.isfinite(moment.velocity):
            rate = -moment.velocity / rig.scale[speed]
            innovation = float((rate - mean[speed]) / np.sqrt(covariance[speed, speed] + rig.variance))
            self._filter.update(rate)
        else:
            status |= Status.BLIND
        self._force = moment.force
        mean, covariance = self._filter.get()
        variance = np.diag(covariance)
        if not (np.isfinite(mean).all() and (variance >= 0).all() and abs(mean[depth] * rig.scale[depth]) < 0.1):
            raise FloatingPointError
        values, std = mean * rig.scale, np.sqrt(variance) * rig.scale
        self._surface = moment.position + values[depth]
        where = rig.process.parameters
        status |= Status.LIFTED if values[depth] <= 0 else Status(0)
        height, force = (float(values[depth]), float(std[depth])), rig.force(mean)
        return Belief(values[where], std[where], *height, force, innovation**2, int(status), innovation)

    def _begin(self, moment: Moment) -> Status:
        rig, depth = self._rig, self._surface - moment.position
        place, last = rig.process.layout.at("depth"), rig.process.layout.span("memory", "derivatives")
        resumed = self._begun and depth > 0
        mean, covariance = rig.start.mean / rig.scale, np.eye(len(rig.scale))
        if resumed:
            before, spread = self._filter.get()
            mean[last], covariance[last, last] = before[last], spread[last, last]
            mean[place] = depth / rig.scale[place]
            covariance[place, place] = spread[place, place] + (_RESUME_STD / rig.scale[place]) ** 2
        mean[rig.speed] = -moment.velocity / rig.scale[rig.speed] if np.isfinite(moment.velocity) else 0.0
        self._filter.put(mean, covariance)
        self._begun = True
        return Status.RESUMED if resumed else Status(0)
