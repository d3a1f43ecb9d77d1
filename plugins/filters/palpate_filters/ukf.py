"""The unscented Kalman filter on the inertial process, and the paper's one with adaptive fading."""

from __future__ import annotations

from typing import Any

from palpate import Problem, Tracker
from pydantic import Field, model_validator

from palpate_filters.adaptive_fading import PRESET, AdaptiveFading, Preset, preset_below
from palpate_filters.inertial_filter import InertialFilter, inertial_tracker
from palpate_filters.predictions import Points, unscented

_ALPHA = "spread of the sigma points around the mean (merwe)"
_BETA = "weight of the centre in the covariance; 2 for a Gaussian (merwe)"
_KAPPA = "secondary spread: alpha^2 (n + kappa) is the squared reach of the points (merwe, julier)"
_REDRAW = "whether the update includes the process noise, as if sigma points were drawn again after the prediction"


class UnscentedKalmanFilter(InertialFilter):
    """The unscented Kalman filter: the paper's process and measurement, without linearisation.

    Sigma points of van der Merwe, Julier or the simplex, propagated through `palpate.InertialProcess`; the velocity is
    a linear measurement, so its update is exact. Source: Wan and van der Merwe 2000.
    """

    points: Points = Field(default="merwe", description="kind of sigma points")
    spread: float = Field(default=1e-3, gt=0, le=10, description=_ALPHA)
    beta: float = Field(default=2.0, allow_inf_nan=False, description=_BETA)
    kappa: float = Field(default=0.0, gt=-2, allow_inf_nan=False, description=_KAPPA)
    redraw: bool = Field(default=True, description=_REDRAW)

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        prediction = unscented(self.points, self.spread, self.beta, self.kappa, self.redraw)
        return inertial_tracker(self, problem, prediction)


class AdaptiveFadingUkf(InertialFilter):
    """The paper's AFUKF: an unscented Kalman filter with adaptive fading on the expanded state (order 2: 8 states).

    For sweeps. Fading with process noise of rank one winds the covariance up where theta is below the innovation's
    standard deviation; `fading.covariance_cap` contains it, and what still runs away is marked as diverged.
    Source: paper, eq. state_space_NL_FT_plus and section Dynamic Estimation; Hu et al. 2015.
    """

    points: Points = Field(default="merwe", description="kind of sigma points")
    spread: float = Field(default=1e-3, gt=0, le=10, description=_ALPHA)
    beta: float = Field(default=2.0, allow_inf_nan=False, description=_BETA)
    kappa: float = Field(default=0.0, gt=-2, allow_inf_nan=False, description=_KAPPA)
    redraw: bool = Field(default=True, description=_REDRAW)
    preset: Preset = Field(default="palpate", description=PRESET)
    fading: AdaptiveFading = Field(default=AdaptiveFading(), description="how the covariance is inflated")
    order: int = Field(
        default=2, ge=0, le=4, description="evolution order: number of time derivatives of the parameters as states"
    )

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, data: Any) -> Any:
        return preset_below(data, authors={"redraw": False})

    @property
    def follows_changes(self) -> bool:
        """See `palpate.Estimator`."""
        return True

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        prediction = unscented(self.points, self.spread, self.beta, self.kappa, self.redraw)
        return inertial_tracker(self, problem, prediction, self.fading)
