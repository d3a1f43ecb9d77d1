"""Meanings of the flags of a fit, in addition to those that the core registers."""

from __future__ import annotations

from palpate import FlagMeaning

FIT_FLAGS = {
    "not-fitted": FlagMeaning.sign("no-estimate", "No fit was made, for the reason that is given."),
    "too-few-samples": FlagMeaning.sign("no-estimate", "There are too few samples to fit."),
    "segment-empty": FlagMeaning.sign("no-estimate", "The segment holds no samples."),
    "no-force": FlagMeaning.sign("no-estimate", "The record has no force, or one that never changes."),
    "no-time": FlagMeaning.sign("no-estimate", "The time does not advance from every sample to the next."),
    "misfit": FlagMeaning.sign("lack-of-fit", "The residual is more than twice the noise."),
    "correlated-residuals": FlagMeaning.sign(
        "lack-of-fit", "The residuals correlate over many samples; the uncertainty counts it."
    ),
    "at-bound": FlagMeaning(
        "doubtful",
        "An unknown ended at a bound.",
        "Widen the bound, or fix the unknown, with a reason for either.",
    ),
    "hard-to-tell-apart": FlagMeaning.sign("undetermined", "Two unknowns have nearly the same effect on the force."),
    "force-constraint-tight": FlagMeaning(
        "doubtful",
        "The force_uncertainty of the surface is less than the force is off in air.",
        "Tare, or allow more force_uncertainty.",
    ),
    "force-constraint-unused": FlagMeaning(
        "note", "The record has no approach through air that force_uncertainty could use.", "Leave it out."
    ),
}
