"""The flags that the core raises, registered as a plugin's are."""

from __future__ import annotations

from palpate.flags import FlagMeaning
from palpate.hooks import plugin


def _invalid(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("invalid", meaning, remedy)


def _doubtful(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("doubtful", meaning, remedy)


def _note(meaning: str, remedy: str) -> FlagMeaning:
    return FlagMeaning("note", meaning, remedy)


_ESTIMATE = {
    "diagnosis-failed": _doubtful(
        "A plugin that judges results ended in an error; its judgement is missing.",
        "Report the error to the plugin's authors.",
    ),
    "no-contact": _invalid(
        "The force never stayed above the touch threshold; nothing was estimated.",
        "Press deeper, or look at sign, tare and channel of the force.",
    ),
    "no-estimate": _invalid(
        "Nothing was estimated, for the reason that is given.",
        "Palpate for longer, or change the setting that the message names.",
    ),
    "never-started": FlagMeaning.sign(
        "no-estimate", "The samples in contact were too few for the estimator to start on."
    ),
    "failed": _invalid(
        "The code of an estimator or a contact model raised an exception, or answered in a wrong form; none is given.",
        "Fix the plugin where the message says; parts have checks (docs: plugins/testing).",
    ),
    "diverged": _invalid(
        "The estimates stopped being finite or plausible numbers; none is given.",
        "Start from a closer guess, check units, signs and timing, or use another estimator.",
    ),
    "not-identifiable": _invalid(
        "The force changes too little against its noise, or a parameter has too little effect on it, to be estimated.",
        "Palpate with a larger amplitude or deeper.",
    ),
    "contradicted": _doubtful(
        "Another track of the same model, which is as good, finds another value.",
        "Compare what the two estimators assume (`palpate describe`), and use the fit where there is one.",
    ),
    "undetermined": _note(
        "The record does not determine a value: it may be none within two standard uncertainties.",
        "Press at two speeds or oscillate, in which a viscosity shows; press deeper for any other value.",
    ),
    "not-converged": _doubtful(
        "The estimate still moves at the end, too little was tracked, or a solver stopped early.",
        "Palpate for longer, or use an estimator that converges faster.",
    ),
    "filter-unstable": _doubtful(
        "The filter left its range: it restarted, its depth was not positive, or its step was too long.",
        "Use a kinematic filter, or check tare, touch threshold and the noise that is declared.",
    ),
    "depth-not-positive": FlagMeaning.sign(
        "filter-unstable", "The estimated depth was not positive although the force says that there is contact."
    ),
    "restarted": FlagMeaning.sign("filter-unstable", "The filter restarted from its start values."),
    "too-stiff": FlagMeaning.sign("filter-unstable", "The contact is too stiff for the filter's time step."),
    "covariance-repaired": FlagMeaning.sign(
        "filter-unstable", "The covariance lost its positivity to rounding and was repaired."
    ),
    "resumed": FlagMeaning.sign("gaps", "The estimate was carried over a pause in the samples or in the contact."),
    "blind": FlagMeaning.sign("gaps", "Samples lacked a measurement and were predicted only."),
}

_RECORD = {
    "invalid": FlagMeaning.sign("gaps", "A stream has readings that are marked invalid."),
    "duplicates": FlagMeaning.sign("gaps", "Time-stamps of a stream are repeated."),
    "backwards": _doubtful(
        "The time of a stream goes backwards.", 'Use another clock, such as time = "log", or record again.'
    ),
    "gaps": _note(
        "Readings of a stream are missing, repeated or marked invalid.", "Look at the recording, where they are many."
    ),
    "lost-readings": _doubtful(
        "More than one in twenty samples has no force.", "Look at the force's stream, and record again."
    ),
    "saturated": _doubtful("Readings are at the limit of the sensor's range.", "Press less deep, or change the range."),
    "stuck": _doubtful(
        "A stream repeats exactly one reading for long.", "Look at sensor and driver; record at the true rate."
    ),
    "rate-contradicted": _doubtful(
        "The time-stamps of a stream give another rate than it announces, by a factor of 1.05 or more.",
        "Announce the rate of its readings, or correct its time-stamps.",
    ),
    "wrong-stamps": _invalid(
        "The time-stamps of a stream give a rate that is off the announced one by a factor of 2 or more.",
        "Send time-stamps in nanoseconds and rates in Hz; the message names the unit that is likely.",
    ),
    "clock-drift": _doubtful(
        "The time-stamps of force and motion gain on one another over the record.",
        'Use one clock for both, such as time = "log".',
    ),
    "clock-wander": _doubtful(
        "The clock of a device strayed by more than the timing's declared uncertainty.",
        "Keep the machine for the rig, or declare a larger uncertainty in [alignment].",
    ),
    "turned-weight": _doubtful(
        "The tool turns, and its weight counts as constant, or is not what mass, mounting and gravity say.",
        'Set [alignment] weight = "turning", and find mounting and mass by `palpate calibrate` with orientations.',
    ),
    "turned-tool": FlagMeaning.sign(
        "turned-weight", "The tool turns within the record, and its weight counts as constant."
    ),
    "payload": _note(
        "The payload that the robot counts on, or its centre of mass, is not what hangs on it.",
        "Set payload and payload_centre of the arm, or correct them on the pendant.",
    ),
    "touched-again": _note("Contact was lost and found again.", "Nothing, unless one contact was meant."),
    "backlog": _note(
        "Estimates of a live run came more than a second after their readings, or end before the record does.",
        "Use fewer or faster tracks, or a less busy computer; a replay of the log makes all estimates.",
    ),
    "ended-early": _doubtful(
        "A device that no safety check needs ended its stream while an arm still moved.",
        "Look at the device and its driver; what it would have sent is missing.",
    ),
    "interrupted": _note(
        "The run was stopped before its end.",
        "`palpate run resume` does what was left; of a rehearsal in simulated time, where nothing real moves.",
    ),
    "rehearsal": _note(
        "The run is a rehearsal in simulated time: twin and specimen in software, nothing was measured.",
        "`palpate run FILE` measures, by the pipeline file of the rig; what starts from this folder stays in simulated "
        "time. The specimen is under run.rehearsal of result.json.",
    ),
    "lost-periods": _note(
        "More than 1 % of an arm's periods of 2 ms had no command: its motion is slower than planned.",
        "Make the driver's calls faster, or use a less busy computer with real-time priority; values are those of the "
        "motion that was made.",
    ),
    "device": _note(
        "A device or a log has a message, a distribution was left out, or a limit is looser than that of a base.",
        "Read the message.",
    ),
}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meanings of the core's own flags."""
    return {**_ESTIMATE, **_RECORD}
