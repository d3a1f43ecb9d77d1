"""Meanings of the flags of this family, and those of them that are signs of one cause."""

from __future__ import annotations

from palpate import FlagMeaning


def _doubtful(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("doubtful", meaning, remedy)


def _note(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("note", meaning, remedy)


_MODEL = {
    "lack-of-fit": _doubtful(
        "The record contradicts a fact that is stated of rig or specimen, or its law describes nothing of it.",
        "State what is open of tip and specimen; press again with over 300 readings in contact, or to a second depth, "
        "which shows the cause; or compare laws (`palpate fit choose --help`).",
    ),
    "model-discrepancy": _note(
        "The material is not exactly of the law; what that does to each value is in its uncertainty.",
        "Use a model of the reason that is named for a smaller uncertainty (`palpate fit choose --help`).",
    ),
    "inconsistent": FlagMeaning.sign("lack-of-fit", "The innovations are larger or smaller than the filter expects."),
    "coloured-innovations": FlagMeaning.sign("lack-of-fit", "Innovations correlate from sample to sample."),
    "elsewhere": FlagMeaning.sign(
        "lack-of-fit",
        "Least squares on the samples that a filter used ends more than three uncertainties from its estimate.",
    ),
    "overconfident": FlagMeaning.sign(
        "lack-of-fit", "The filter's standard deviation is below half of the Cramer-Rao bound of the samples it used."
    ),
    "implausible": FlagMeaning(
        "doubtful",
        "A parameter is outside of what is possible, by more than its standard deviation explains; it has no value.",
        "Check units and signs, declare delays, or use a model without that parameter.",
        voids=True,
    ),
    "surface-mismatch": _doubtful(
        "The estimated surface is not where the tip first touched.",
        "Check model and tip, and whether the first touch was real.",
    ),
    "beyond-model-range": _doubtful(
        "Depth or tip is outside the range of the model or of its thickness correction.",
        "Palpate less deep, or use a model that is valid there.",
    ),
    "off-normal": _doubtful(
        "The tool stands off the skin's normal, where the contact of its tip is not well known.",
        "Turn the tool along the normal (trajectories over a surface do), or press with a sphere.",
    ),
    "far-off-normal": FlagMeaning(
        "invalid",
        "The tool stands so far off the skin's normal that no value holds for its tip.",
        "Turn the tool along the normal, press with a sphere, or check that the z of its pose looks at the skin.",
    ),
    "model-choice": _note(
        "Several models are admitted; it gives the record's evidence for each, and their combined value.",
        "Give the combined value, or state the geometry that leaves one model.",
    ),
    "choice-incomplete": FlagMeaning(
        "doubtful",
        "A model that the stated geometry admits has no result, so the spread of the models does not include it.",
        "Correct the name in [choice] candidates, or let the model run with the same estimator.",
    ),
    "unloading": _doubtful(
        "During unloading, a material with memory leaves the tip sooner than a contact that follows the depth.",
        'Use ting-fit (one loading, one unloading), or fit the loading only (casadi-fit, segment = "load").',
    ),
    "pull-off": _doubtful(
        "The material pulls the tip on its way out, and the model leaves adhesion out.",
        "Use the model jkr (soft, large tips) or dmt (stiff, small ones), or wet the surface.",
    ),
    "outliers": _doubtful(
        "Single readings of the force are off by many times its noise, and the estimator gives them full weight.",
        "Set student = 4 (kinematic filters), a robust loss (fits), or find out what disturbs the sensor.",
    ),
}

_RIG = {
    "delay-unclear": _doubtful(
        "The delay between force and motion is not known to what a value needs.",
        "Calibrate the delay (`palpate calibrate`), or declare it with its uncertainty in [alignment]; log the "
        "measured pose, not the command.",
    ),
    "timing-undeclared": FlagMeaning.sign(
        "delay-unclear", "No uncertainty of the time between force and motion is declared."
    ),
    "self-timed": _note(
        "The motion determines the delay of the force, law by law.", "Declare it with its uncertainty in [alignment]."
    ),
    "delay-by-law": FlagMeaning.sign(
        "delay-unclear", "The record prefers a law other than the model's, with another delay."
    ),
    "force-late": _doubtful(
        "The force lags the motion by more than any passive contact can explain; no viscosity is valid.",
        "Calibrate the timing (`palpate calibrate`), or declare the force's delay in [alignment].",
    ),
    "velocity-other": FlagMeaning(
        "invalid",
        "The stated velocity is not how the position changes: of another unit, axis, sign or tip, or frozen.",
        "Look at the channels of position and velocity, or leave the velocity out.",
    ),
    "velocity-late": _doubtful(
        "The velocity lags the position: filtered (a mean of n samples is late by (n - 1)/2), or of another clock.",
        "Declare the velocity's delay in [alignment], or leave the velocity out.",
    ),
    "tare-unclear": _doubtful(
        "The force without contact is not known to what a value needs.",
        'Record a second of free air first (tare = "free-air") or set [alignment] tare_uncertainty; find hum, drag, '
        "cable or drift that it names.",
    ),
    "untared": FlagMeaning.sign("tare-unclear", "Before the first touch the force is not zero."),
    "zeroed-in-contact": FlagMeaning.sign(
        "tare-unclear", "The force was zeroed where the tip was below the estimated surface."
    ),
    "force-in-air": FlagMeaning.sign(
        "tare-unclear", "In air the force follows the motion, has its frequency, or is not zero after the contact."
    ),
    "series-compliance": _note(
        "Robot and sensor give way, which shifts a value by more than 1 %; counted as uncertainty, not corrected.",
        "Stiffen the rig, or measure the position at the tip.",
    ),
    "inclined-skin": _doubtful(
        "The force across the tool is not that of a skin as inclined as is stated, or of a level one, whatever the "
        "friction.",
        'Align the tool with the normal, or state skin = { inclination = "10 deg" } next to the model\'s indenter.',
    ),
}

FLAGS = {**_MODEL, **_RIG}
