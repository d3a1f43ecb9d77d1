"""The paper's extended Kalman filter, and the same with adaptive fading."""

from __future__ import annotations

from typing import Any

from palpate import Problem, Tracker
from pydantic import Field, model_validator

from palpate_filters.adaptive_fading import PRESET, Preset, StrongFading, preset_below
from palpate_filters.inertial_filter import InertialFilter, inertial_tracker
from palpate_filters.predictions import linearised


class ExtendedKalmanFilter(InertialFilter):
    """The paper's filter: state depth, rate and the model's parameters; input force, measurement velocity.

    Process: `palpate.InertialProcess` (paper, eq. state_space_NL_FT) with Q = B sigma_u^2 B^T; measurement: the tip's
    velocity. Each step updates with the velocity, then predicts with the force. The Jacobian is derived.
    Known faults of this form (simulated): eta 3 to 8 % high at 2 Hz, because the noisy force drives the state (it is
    predicted and corrected in the result), E some 2 % high after 10 s from a guess; a standard deviation far too small.
    """

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return inertial_tracker(self, problem, linearised)


class AdaptiveFadingEkf(InertialFilter):
    """The paper's AFEKF: the extended Kalman filter with a covariance that is inflated while innovations are large.

    For sweeps, where the material changes under the tip; on a point it only adds noise (2 to 7 of 50 simulated runs end
    more than 10 % off). Source: paper, section Dynamic Estimation; Kim, Lee and Park 2007.
    """

    preset: Preset = Field(default="palpate", description=PRESET)
    fading: StrongFading = Field(default=StrongFading(), description="how the covariance is inflated")

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, data: Any) -> Any:
        return preset_below(data)

    @property
    def follows_changes(self) -> bool:
        """See `palpate.Estimator`."""
        return True

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return inertial_tracker(self, problem, linearised, self.fading)
