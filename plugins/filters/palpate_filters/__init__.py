"""Filters and fits."""

from palpate import Estimator, plugin

from palpate_filters.ekf import ExtendedKalmanFilter
from palpate_filters.fit import CasadiFit


@plugin
def palpate_estimators() -> dict[str, type[Estimator]]:
    """Filters and fits."""
    return {"ekf": ExtendedKalmanFilter, "casadi-fit": CasadiFit}
