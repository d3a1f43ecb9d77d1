"""Offline fits of contact models to recorded palpations, with the surface unknown.

`fit_settings` holds the keys of `estimator`, `tracker` leads through a fit: `residual` is made of `record_arrays`,
`first_guess` and `solvers` find its minimum, `uncertainty`, `profile_likelihood`, `bootstrap` and `budget` say how far
it can be believed, `identifiability` what is indistinct, `report` and `typed_report` what of all this goes into
the result, `flags` what its flags mean. `ting_fit` is for one loading and one unloading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, ReportSection, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate import FlagMeaning

    from palpate_fits.estimator import CasadiFit as CasadiFit
    from palpate_fits.ting_fit import TingFit as TingFit


@plugin
def palpate_estimators() -> dict[str, str]:
    """Fits of a whole record."""
    return {"casadi-fit": "palpate_fits.estimator:CasadiFit", "ting-fit": "palpate_fits.ting_fit:TingFit"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Fits over models and logs."""
    compare, cycles = "palpate fit compare", "palpate fit cycles"
    return {
        "fit": Command(
            "palpate_fits.fit_command:fit",
            "Fit models to logs and folders of curves.",
            "run",
            first_options=(
                *("--tip", "--model", "--thickness", "--delay", "--tip-mass", "--rig"),
                *("--pipeline", "--set", "--out", "--details"),
            ),
            former_options={
                "--cross": compare,
                "--carry": f"{compare} --carry",
                "--no-carry": compare,
                "--cycles": cycles,
            },
        ),
        "fit compare": Command(
            "palpate_fits.compare_command:compare", "What is fitted on each log, evaluated on all others.", "run"
        ),
        "fit cycles": Command("palpate_fits.compare_command:cycles", "Every cycle of a log fitted by itself.", "run"),
    }


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """Offline fits among the tracks of a run."""
    return {
        "offline-fits": ReportSection("palpate_fits.fit_tables:fits_of_a_run", detail=True),
        "best-fit": ReportSection("palpate_fits.fit_tables:best_fit_of_a_run"),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meanings of the flags of fits."""
    from palpate_fits.flags import FIT_FLAGS

    return FIT_FLAGS


__getattr__, __all__ = lazy_names(__name__, *palpate_estimators().values())
