"""Filters and fits."""

from palpate import Estimator, plugin

from palpate_filters.ekf import AdaptiveFadingEkf, ExtendedKalmanFilter
from palpate_filters.filterpy_filter import FilterpyFilter
from palpate_filters.fit import CasadiFit
from palpate_filters.kinematic_filter import IteratedKinematicFilter, KinematicFilter
from palpate_filters.smoother import KinematicSmoother
from palpate_filters.ukf import AdaptiveFadingUkf, UnscentedKalmanFilter


@plugin
def palpate_estimators() -> dict[str, type[Estimator]]:
    """Filters and fits."""
    return {
        "ekf": ExtendedKalmanFilter,
        "afekf": AdaptiveFadingEkf,
        "ukf": UnscentedKalmanFilter,
        "afukf": AdaptiveFadingUkf,
        "filterpy": FilterpyFilter,
        "kinematic-ekf": KinematicFilter,
        "iekf": IteratedKinematicFilter,
        "kinematic-smoother": KinematicSmoother,
        "casadi-fit": CasadiFit,
    }
