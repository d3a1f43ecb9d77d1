"""What keys and types of filters were called before."""

from __future__ import annotations

import math
from typing import Any

from palpate import Migration

_FADING = ("theta", "alpha_max", "step_up", "step_down", "signed", "covariance_cap")


def _walk(density: Any) -> Any:
    """A random walk [N/s^0.5] from its density [N^2/s]."""
    return math.sqrt(density) if isinstance(density, int | float) and density >= 0 else density


RENAMED = (
    Migration("0.2", "estimator", "iekf", becomes="kinematic-ekf", implied={"iterations": 3}),
    *(Migration("0.2", "estimator", name, {key: f"fading.{key}" for key in _FADING}) for name in ("afekf", "afukf")),
    *(
        Migration("0.2", "estimator", name, {"bias_walk": "drift_walk"}, converted={"bias_walk": _walk})
        for name in ("kinematic-ekf", "kinematic-smoother")
    ),
)
