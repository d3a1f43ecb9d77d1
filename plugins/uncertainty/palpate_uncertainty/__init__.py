"""Uncertainty: what the tracks of a run are judged by when it has ended, and what their uncertainty is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Diagnosis, FlagMeaning, ReportSection, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """Judges of every track."""
    # `quick` ones are asked during a run as well, `lost` ones also of tracks without numbers; `after` are those whose
    # findings one takes into account.
    return {
        "plausibility": Diagnosis("palpate_uncertainty.plausibility:plausibility", quick=True),
        "readings": Diagnosis("palpate_uncertainty.reading_faults:reading_faults", quick=True),
        "budget": Diagnosis("palpate_uncertainty.uncertainty_budget:budgets", quick=True),
        "thickness": Diagnosis("palpate_uncertainty.other_geometries:other_geometries", quick=True),
        "late-force": Diagnosis("palpate_uncertainty.delay.late_force:late_force", quick=True, lost=True),
        # Settles what the budget states of undeclared timing, and a condition on it.
        "self-timed": Diagnosis(
            "palpate_uncertainty.delay.delay_from_motion:diagnose_delay",
            after=("readings", "budget", "thickness", "late-force", "open-facts"),
        ),
        # Settles findings on the innovations.
        "model-discrepancy": Diagnosis("palpate_uncertainty.lack_of_fit:lack_of_fit", after=("plausibility",)),
        # By the uncertainty of the surface.
        "touched-surface": Diagnosis(
            "palpate_uncertainty.touched_surface:touched_surface",
            after=("model-discrepancy",),
            quick=True,
            lost=True,
        ),
        "model-choice": Diagnosis("palpate_uncertainty.model_choice:model_choice"),
        # Last, since a filter's bias that is predicted is not a distance.
        "identifiability": Diagnosis(
            "palpate_uncertainty.identifiability:identifiability", after=(Diagnosis.EVERY_OTHER,)
        ),
        # By the whole uncertainty: a viscosity below none within it is one of none.
        "possible-values": Diagnosis(
            "palpate_uncertainty.possible_values:possible_values",
            after=(Diagnosis.EVERY_OTHER, "identifiability"),
            quick=True,
        ),
        # By the whole uncertainty, within which a stated half-space has to hold.
        "motion": Diagnosis(
            "palpate_uncertainty.measured_motion:measured_motion", after=(Diagnosis.EVERY_OTHER, "possible-values")
        ),
        "stiffness-over-depth": Diagnosis("palpate_uncertainty.stiffness_over_depth:stiffness_over_depth"),
        "one-frequency": Diagnosis("palpate_uncertainty.delay.one_frequency:one_frequency"),
        "force-across": Diagnosis("palpate_uncertainty.inclined_skin:inclined_skin", quick=True),
        "tool-off-normal": Diagnosis("palpate_uncertainty.tool_off_normal:tool_off_normal", quick=True),
        "open-facts": Diagnosis("palpate_uncertainty.open_facts:open_facts", quick=True),
        "outliers": Diagnosis("palpate_uncertainty.outliers:outliers"),
        "free-air": Diagnosis("palpate_uncertainty.free_air:free_air"),
        "unloading": Diagnosis("palpate_uncertainty.unloading:unloading"),
        "assumptions": Diagnosis("palpate_uncertainty.assumptions:assumptions", detail=True),
    }


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """Values of a run, the assumptions that they take for exact, and the prediction by their law."""
    return {
        "motion": ReportSection("palpate_uncertainty.measured_motion:motion_lines", order=5, detail=True),
        "prediction": ReportSection("palpate_uncertainty.prediction:prediction_lines", order=79, detail=True),
        "stiffness": ReportSection("palpate_kit.terminal.stiffness_text:stiffness_lines", order=78, detail=True),
        "assumptions": ReportSection("palpate_uncertainty.assumption_line:assumption_lines", order=80, detail=True),
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Models between which only the record can choose."""
    from palpate_uncertainty.settings import ChoiceSettings

    return {"choice": ChoiceSettings}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the budget of a run's uncertainty, and the choice of a model."""
    where = "palpate_uncertainty"
    return {
        "report budget": Command(f"{where}.budget_command:budget", "The uncertainty budget of a run's values."),
        "fit choose": Command(f"{where}.choose_command:choose", "Which of several models the data support."),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Meanings of their flags."""
    from palpate_uncertainty.flag_meanings import FLAGS

    return FLAGS
