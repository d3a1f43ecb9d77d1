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
from palpate_filters.step_limits import MAX_DEPTH, RESUME_STD


class FilterpyFilter(PaperStart):
    """A filter of the filterpy library (Labbe 2015) on the paper's process and measurement.

    Some 500 times slower than the compiled filters here; the ensemble's equations are filterpy's, for all members at
    once. The state is scaled by its first standard deviations, since some of filterpy's filters compare covariances
    with absolute numbers. Where filterpy gives up, such as on a covariance that is not positive, the track diverges.
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
        """Return a tracker; raises ConfigurationError where filterpy, the tip's mass or a first guess is missing."""
        try:
            import filterpy.kalman
        except ImportError as error:
            raise ConfigurationError(f"filterpy cannot be imported ({error}); pip install filterpy") from error
        process = InertialProcess(problem.model, moved_mass(problem))
        start = first_state(self, process, problem)
        scaled_process = ScaledProcess(process, start, self.force_std, self.velocity_std)
        makers: dict[str, Callable[[], Filter]] = {
            "ekf": lambda: extended_filter(scaled_process),
            "ukf": lambda: sigma_point_filter(
                scaled_process, filterpy.kalman.UnscentedKalmanFilter, points=self._sigma_points(process.states)
            ),
            "ckf": lambda: sigma_point_filter(scaled_process, filterpy.kalman.CubatureKalmanFilter),
            "enkf": lambda: ensemble(scaled_process, self.members, self.seed),
        }
        return track_by_step(len(problem.model.parameters), _Stepper(scaled_process, makers[self.filter]))

    def _sigma_points(self, states: int) -> Any:
        """Return filterpy's generator of the sigma points for so many states."""
        from filterpy.kalman import JulierSigmaPoints, MerweScaledSigmaPoints, SimplexSigmaPoints

        if self.points == "merwe":
            return MerweScaledSigmaPoints(states, self.spread, self.beta, self.kappa)
        return JulierSigmaPoints(states, self.kappa) if self.points == "julier" else SimplexSigmaPoints(states)


class _Stepper:
    """The step function of the track."""

    def __init__(self, scaled_process: ScaledProcess, make: Callable[[], Filter]) -> None:
        self._scaled_process, self._filter = scaled_process, make()
        self._force = np.nan
        self._surface = np.nan
        self._has_begun = self._has_diverged = False

    def __call__(self, moment: Moment) -> Belief:
        """Return the estimate after a sample; NaN with the status DIVERGED from the first error of the numerics on."""
        if not self._has_diverged:
            try:
                return self._step(moment)
            except (np.linalg.LinAlgError, ValueError, FloatingPointError):
                self._has_diverged = True
        unknown = np.full(len(self._scaled_process.process.model.parameters), np.nan)
        return Belief(
            values=unknown, std=unknown, depth=np.nan, depth_std=np.nan, force=np.nan, status=int(Status.DIVERGED)
        )

    def _step(self, moment: Moment) -> Belief:
        """Return the estimate after one sample; raises FloatingPointError where the filter diverges.

        The filter's state has units of `scaled_process.scale`, its first standard deviations; `moment` and the estimate
        have SI. `speed` is the row of the depth rate, the only entry that is measured.
        """
        # Predict with the force of the sample before, or begin.
        status = Status(0)
        if moment.first or moment.interval > PAUSE:
            status |= self._begin(moment)
        else:
            self._filter.predict(moment.interval, self._force)
            status |= Status(0) if np.isfinite(self._force) else Status.BLIND
        # Update with the rate; the innovation in standard deviations is that of the prediction.
        scaled_process, (mean, covariance) = self._scaled_process, self._filter.get()
        depth, speed = scaled_process.process.layout.at("depth"), scaled_process.speed
        innovation = np.nan
        if np.isfinite(moment.velocity):
            rate = -moment.velocity / scaled_process.scale[speed]
            innovation = float((rate - mean[speed]) / np.sqrt(covariance[speed, speed] + scaled_process.variance))
            self._filter.update(rate)
        else:
            status |= Status.BLIND
        self._force = moment.force
        # Report in SI.
        mean, covariance = self._filter.get()
        variance = np.diag(covariance)
        is_near = abs(mean[depth] * scaled_process.scale[depth]) < MAX_DEPTH
        if not (np.isfinite(mean).all() and (variance >= 0).all() and is_near):
            raise FloatingPointError
        values, std = mean * scaled_process.scale, np.sqrt(variance) * scaled_process.scale
        self._surface = moment.position + values[depth]
        parameters = scaled_process.process.parameters
        status |= Status.LIFTED if values[depth] <= 0 else Status(0)
        return Belief(
            values=values[parameters],
            std=std[parameters],
            depth=float(values[depth]),
            depth_std=float(std[depth]),
            force=scaled_process.force(mean),
            nis=innovation**2,
            status=int(status),
            innovation=innovation,
        )

    def _begin(self, moment: Moment) -> Status:
        """Start the filter from the first guess, or resume the last estimate; return the status that this sets.

        A contact after a pause is resumed if the tip is below the surface as last estimated. The material's entries
        stay, and the depth is that of the measured position below this surface, which may have moved by `RESUME_STD`
        [m] in the meantime.
        """
        process, scale = self._scaled_process.process, self._scaled_process.scale
        speed_row = self._scaled_process.speed
        depth = self._surface - moment.position  # [m]
        depth_row = process.layout.at("depth")
        material = process.layout.span("memory", "derivatives")
        resumed = self._has_begun and depth > 0
        # The first guess; in units of its own standard deviations its covariance is the unit matrix.
        mean = self._scaled_process.start.mean / scale
        covariance = np.eye(len(scale))
        if resumed:
            last_mean, last_covariance = self._filter.get()
            mean[material] = last_mean[material]
            covariance[material, material] = last_covariance[material, material]
            surface_variance = (RESUME_STD / scale[depth_row]) ** 2
            mean[depth_row] = depth / scale[depth_row]
            covariance[depth_row, depth_row] = last_covariance[depth_row, depth_row] + surface_variance
        # The rate of the depth is the measured one.
        mean[speed_row] = -moment.velocity / scale[speed_row] if np.isfinite(moment.velocity) else 0.0
        self._filter.put(mean, covariance)
        self._has_begun = True
        return Status.RESUMED if resumed else Status(0)
