"""Filters and fits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Diagnosis, Fact, ReportSection, Template, lazily, plugin

if TYPE_CHECKING:
    from palpate import FlagMeaning, Migration

    from palpate_filters.ekf import AdaptiveFadingEkf, ExtendedKalmanFilter
    from palpate_filters.filterpy_filter import FilterpyFilter
    from palpate_filters.fit import FIT_FLAGS, CasadiFit
    from palpate_filters.kernel import Kernel, Step, compile_step
    from palpate_filters.kinematic_filter import KinematicFilter
    from palpate_filters.process import InertialProcess, KinematicProcess
    from palpate_filters.renamed import RENAMED
    from palpate_filters.smoother import KinematicSmoother
    from palpate_filters.ting_fit import TingFit
    from palpate_filters.ukf import AdaptiveFadingUkf, UnscentedKalmanFilter

__getattr__ = lazily(
    __name__,
    {
        "palpate_filters.ekf": "AdaptiveFadingEkf ExtendedKalmanFilter",
        "palpate_filters.filterpy_filter": "FilterpyFilter",
        "palpate_filters.fit": "FIT_FLAGS CasadiFit",
        "palpate_filters.kernel": "Kernel Step compile_step",
        "palpate_filters.kinematic_filter": "KinematicFilter",
        "palpate_filters.process": "InertialProcess KinematicProcess",
        "palpate_filters.renamed": "RENAMED",
        "palpate_filters.smoother": "KinematicSmoother",
        "palpate_filters.ting_fit": "TingFit",
        "palpate_filters.ukf": "AdaptiveFadingUkf UnscentedKalmanFilter",
    },
)

__all__ = [
    "FIT_FLAGS",
    "RENAMED",
    "AdaptiveFadingEkf",
    "AdaptiveFadingUkf",
    "CasadiFit",
    "ExtendedKalmanFilter",
    "FilterpyFilter",
    "InertialProcess",
    "Kernel",
    "KinematicFilter",
    "KinematicProcess",
    "KinematicSmoother",
    "Step",
    "TingFit",
    "UnscentedKalmanFilter",
    "compile_step",
]


@plugin
def palpate_estimators() -> dict[str, str]:
    """Filters and fits."""
    return {
        "ekf": "palpate_filters.ekf:ExtendedKalmanFilter",
        "afekf": "palpate_filters.ekf:AdaptiveFadingEkf",
        "ukf": "palpate_filters.ukf:UnscentedKalmanFilter",
        "afukf": "palpate_filters.ukf:AdaptiveFadingUkf",
        "filterpy": "palpate_filters.filterpy_filter:FilterpyFilter",
        "kinematic-ekf": "palpate_filters.kinematic_filter:KinematicFilter",
        "kinematic-smoother": "palpate_filters.smoother:KinematicSmoother",
        "casadi-fit": "palpate_filters.fit.estimator:CasadiFit",
        "ting-fit": "palpate_filters.ting_fit:TingFit",
    }


@plugin
def palpate_migrations() -> tuple[Migration, ...]:
    """Former names."""
    from palpate_filters.renamed import RENAMED

    return RENAMED


@plugin
def palpate_commands() -> dict[str, Command]:
    """Offline fits over models and logs; filters for controllers."""
    return {
        "fit": Command("palpate_filters.fit.command:fit", "Offline fits of models to logs, side by side."),
        "export-filter": Command(
            "palpate_filters.controller.command:export_filter", "A filter as C99, for a controller."
        ),
    }


@plugin
def palpate_facts() -> dict[str, Fact]:
    """Which kernel runs the filters."""
    return {"kernel": Fact("palpate_filters.kernel:told_kernel")}


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """Offline fits among the tracks of a run."""
    return {"offline-fits": ReportSection("palpate_filters.fit.tables:fits_of_a_run")}


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """What filters on the inertial process are off by."""
    return {"noise-bias": Diagnosis("palpate_filters.noise_bias:noise_bias")}


@plugin
def palpate_templates() -> dict[str, Template]:
    """What a pipeline needs besides a log."""
    return {"log-analysis": Template("palpate_filters", "templates/log_analysis.toml", "tip, model and estimators")}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """What the flags of filters and fits mean."""
    from palpate_filters.fit import FIT_FLAGS
    from palpate_filters.noise_bias import BIAS_FLAGS

    return {**FIT_FLAGS, **BIAS_FLAGS}
