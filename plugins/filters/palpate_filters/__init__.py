"""Filters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Diagnosis, Fact, Template, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate import FlagMeaning

    from palpate_filters.ekf import AdaptiveFadingEkf as AdaptiveFadingEkf, ExtendedKalmanFilter as ExtendedKalmanFilter
    from palpate_filters.filterpy_filter import FilterpyFilter as FilterpyFilter
    from palpate_filters.kinematic_filter import KinematicFilter as KinematicFilter
    from palpate_filters.process_models import InertialProcess as InertialProcess, KinematicProcess as KinematicProcess
    from palpate_filters.smoother import KinematicSmoother as KinematicSmoother
    from palpate_filters.ukf import (
        AdaptiveFadingUkf as AdaptiveFadingUkf,
        UnscentedKalmanFilter as UnscentedKalmanFilter,
    )


@plugin
def palpate_estimators() -> dict[str, str]:
    """Recursive filters and a smoother."""
    return {
        "ekf": "palpate_filters.ekf:ExtendedKalmanFilter",
        "afekf": "palpate_filters.ekf:AdaptiveFadingEkf",
        "ukf": "palpate_filters.ukf:UnscentedKalmanFilter",
        "afukf": "palpate_filters.ukf:AdaptiveFadingUkf",
        "filterpy": "palpate_filters.filterpy_filter:FilterpyFilter",
        "kinematic-ekf": "palpate_filters.kinematic_filter:KinematicFilter",
        "kinematic-smoother": "palpate_filters.smoother:KinematicSmoother",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """Filters for controllers."""
    return {
        "model export": Command(
            "palpate_filters.c_export.export_command:export_filter",
            "A model with its filter as C99, for a controller.",
        ),
    }


@plugin
def palpate_facts() -> dict[str, Fact]:
    """Return the facts that this family adds to `palpate info`: the kernel that runs the filters."""
    return {"kernel": Fact("palpate_kit.kernel:kernel_description")}


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """Return the bias of filters by their own noise."""
    # Only a bias that counts against the combined uncertainty is stated.
    terms = ("readings", "budget", "thickness", "late-force", "self-timed", "force-across")
    return {"noise-bias": Diagnosis("palpate_filters.bias_diagnosis:diagnose_bias", after=terms)}


@plugin
def palpate_templates() -> dict[str, Template]:
    """Return the parts of a pipeline besides its log."""
    file = "templates/{}_analysis.toml"
    return {
        "log-analysis": Template("palpate_filters", file.format("log"), "tip, model and estimators"),
        "sweep-analysis": Template("palpate_filters", file.format("sweep"), "tip, model and smoother of a sweep"),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meanings of the flags of filters."""
    from palpate_filters.flags import FILTER_FLAGS

    return FILTER_FLAGS


__getattr__, __all__ = lazy_names(
    __name__,
    *palpate_estimators().values(),
    "palpate_filters.process_models:InertialProcess",
    "palpate_filters.process_models:KinematicProcess",
)
