"""What the flags of a fit mean, beside those that the core registers."""

from __future__ import annotations

from palpate import FlagMeaning

_OTHER_SEGMENT = "Choose another segment, or look at the record."

FIT_FLAGS = {
    "not-fitted": FlagMeaning(
        "invalid", "No fit was made, for the reason that is given.", "Change the setting that the message names."
    ),
    "too-few-samples": FlagMeaning("invalid", "There are too few samples to fit.", _OTHER_SEGMENT),
    "segment-empty": FlagMeaning("invalid", "The segment holds no samples.", _OTHER_SEGMENT),
    "no-force": FlagMeaning(
        "invalid", "The record has no force, or one that never changes.", "Look at the sensor and the force's channel."
    ),
    "no-time": FlagMeaning(
        "invalid", "The time does not advance from every sample to the next.", "Look at the record's time."
    ),
    "misfit": FlagMeaning(
        "doubtful",
        "The residual is more than twice the noise: something is not in the model.",
        "Compare other models, or free more unknowns.",
    ),
    "correlated-residuals": FlagMeaning(
        "doubtful",
        "The residuals correlate over many samples; the uncertainty counts it, but something is not in the model.",
        "Compare other models, or free more unknowns.",
    ),
    "at-bound": FlagMeaning(
        "doubtful", "An unknown ended at a bound.", "Widen the bound, or fix the unknown, with a reason for either."
    ),
    "hard-to-tell-apart": FlagMeaning(
        "doubtful",
        "Two unknowns have nearly the same effect on the force, so that neither is known by itself.",
        "Fix one of them, or record a richer motion.",
    ),
    "undetermined": FlagMeaning(
        "doubtful",
        "The standard uncertainty of a parameter is more than half of its value.",
        "Record a motion on which the parameter has more effect.",
    ),
    "force-constraint-tight": FlagMeaning(
        "doubtful",
        "The force_uncertainty of the surface is less than the force is off in air.",
        "Tare, or allow more force_uncertainty.",
    ),
    "force-constraint-unused": FlagMeaning(
        "note", "The record has no approach through air that force_uncertainty could use.", "Leave it out."
    ),
}
