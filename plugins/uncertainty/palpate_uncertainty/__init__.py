"""Uncertainty: what the tracks of a run are judged by when it has ended, and what their uncertainty is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Diagnosis, FlagMeaning, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """Judges of every track."""
    return {
        "plausibility": Diagnosis("palpate_uncertainty.plausibility:plausibility", order=0, quick=True),
        # What others judge by holds its terms.
        "budget": Diagnosis("palpate_uncertainty.uncertainty_budget:budgets", order=10, quick=True),
        "late-force": Diagnosis("palpate_uncertainty.delay.late_force:late_force", order=10, quick=True, lost=True),
        # Settles what the budget states of undeclared timing.
        "self-timed": Diagnosis("palpate_uncertainty.delay.delay_from_motion:diagnose_delay", order=11),
        "lack-of-fit": Diagnosis("palpate_uncertainty.lack_of_fit:lack_of_fit"),
        "model-choice": Diagnosis("palpate_uncertainty.model_choice:model_choice"),
        # Last, since a filter's bias that is predicted is no distance.
        "identifiability": Diagnosis("palpate_uncertainty.identifiability:identifiability", order=60),
        "one-frequency": Diagnosis("palpate_uncertainty.delay.one_frequency:one_frequency"),
        "geometry": Diagnosis("palpate_uncertainty.undeclared_thickness:geometry", quick=True),
        "outliers": Diagnosis("palpate_uncertainty.outliers:outliers"),
        "unloading": Diagnosis("palpate_uncertainty.unloading:unloading"),
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Models between which only the record can choose."""
    from palpate_uncertainty.settings import ChoiceSettings

    return {"choice": ChoiceSettings}


@plugin
def palpate_commands() -> dict[str, Command]:
    """What the uncertainty of a run is made of, and the choice of a model."""
    where = "palpate_uncertainty"
    return {
        "report budget": Command(
            f"{where}.budget_command:budget", "The uncertainty budget of a run's values.", former="budget"
        ),
        "fit choose": Command(
            f"{where}.choose_command:choose", "Which of several models the data support.", former="choose"
        ),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """What their flags mean."""
    from palpate_uncertainty.plausibility import PLAUSIBILITY_FLAGS

    return {
        **PLAUSIBILITY_FLAGS,
        "timing-undeclared": FlagMeaning(
            "doubtful",
            "A parameter depends on the time between force and motion, of which no uncertainty is declared.",
            "Declare delay and uncertainty in [alignment], or calibrate them.",
        ),
        "self-timed": FlagMeaning(
            "note",
            "The timing is not declared; the motion determines the delay of the force, law by law.",
            "Give the corrected value, or declare the delay with its uncertainty in [alignment].",
        ),
        "thickness-undeclared": FlagMeaning(
            "note",
            "No thickness of the specimen is declared, and a layer is stiffer than the half-space of the model.",
            'Set thickness of the model: { height = "22 mm", bonded = false }, or "half-space" where it is thick.',
        ),
        "one-frequency": FlagMeaning(
            "note",
            "At one frequency a fast-fading stiffness looks like viscosity; here it could be more than half of it.",
            "Palpate at several frequencies, or call it the viscosity at this frequency.",
        ),
        "delay-by-law": FlagMeaning(
            "doubtful",
            "The motion determines the delay of the force, but the record prefers a law other than the model's.",
            "Calibrate the delay and declare it, or use a model of the law named.",
        ),
        "tare-undeclared": FlagMeaning(
            "doubtful",
            "A parameter depends on the zero of the force, of which no uncertainty is declared or measured.",
            'Record a second of free air first (tare = "free-air"), or set [alignment] tare_uncertainty.',
        ),
        "not-distinguishable-from-delay": FlagMeaning(
            "doubtful",
            "The declared uncertainty of timing alone could explain the parameter.",
            "Calibrate the delay, or palpate at another frequency.",
        ),
        "series-compliance": FlagMeaning(
            "note",
            "Robot and sensor give way, which shifts a value by more than 1 %; counted as uncertainty, not corrected.",
            "Stiffen the rig, or measure the position at the tip.",
        ),
        "force-late": FlagMeaning(
            "doubtful",
            "The force lags the motion by more than any passive contact can explain; no viscosity is valid.",
            "Calibrate the timing (`palpate calibrate`), or declare the force's delay in [alignment].",
        ),
        "lack-of-fit": FlagMeaning(
            "doubtful",
            "The model's residual is not the noise that the channel had at standstill, and it matters.",
            "Use a model of the named reason (thickness, memory, timing, lift-off, tip, drift), or declare it.",
        ),
        "elsewhere": FlagMeaning(
            "doubtful",
            "Least squares on the samples that a filter used ends more than three uncertainties from its estimate.",
            "Use a kinematic filter or a fit, palpate for longer, or use a model with fewer parameters.",
        ),
        "overconfident": FlagMeaning(
            "doubtful",
            "The filter's standard deviation is below half of the Cramer-Rao bound of the samples that it used.",
            "Use a model with fewer parameters, or a motion that distinguishes them: several frequencies, or a ramp.",
        ),
        "model-choice": FlagMeaning(
            "note",
            "Several models are admitted; it gives the record's evidence for each, and their combined value.",
            "Give the combined value, or state the geometry that leaves one model.",
        ),
        "choice-incomplete": FlagMeaning(
            "doubtful",
            "A model that the stated geometry admits has no result, so the spread of the models does not include it.",
            "Correct the name in [choice] candidates, or let the model run with the same estimator.",
        ),
        "unloading": FlagMeaning(
            "doubtful",
            "During unloading, a material with memory leaves the tip sooner than a contact that follows the depth.",
            'Use ting-fit (one loading, one unloading), or fit the loading only (casadi-fit, segment = "load").',
        ),
        "outliers": FlagMeaning(
            "doubtful",
            "Single readings of the force are off by many times its noise, and the estimator gives them full weight.",
            "Set student = 4 (kinematic filters), a robust loss (fits), or find out what disturbs the sensor.",
        ),
    }
