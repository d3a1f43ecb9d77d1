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
    "never-started": _invalid(
        "The samples in contact were too few for the estimator to start on; nothing was estimated.",
        "Palpate for longer, or shorten the estimator's start_duration.",
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
    "not-converged": _doubtful(
        "The estimate still moves at the end, too little was tracked, or a solver stopped early.",
        "Palpate for longer, or use an estimator that converges faster.",
    ),
    "depth-not-positive": _doubtful(
        "The estimated depth was not positive although the force says that there is contact.",
        "Check tare and touch threshold, or use a kinematic filter.",
    ),
    "restarted": _doubtful(
        "The filter restarted from its start values.",
        "Check the noise that is declared, or use a kinematic filter.",
    ),
    "resumed": _note(
        "The estimate was carried over a pause in the samples or in the contact.",
        "Nothing, unless gaps are not expected.",
    ),
    "too-stiff": _doubtful(
        "The contact is too stiff for the filter's time step.",
        "Record faster, use a lighter tip, or use a kinematic filter.",
    ),
    "covariance-repaired": _doubtful(
        "The covariance lost its positivity to rounding and was repaired.",
        "Declare a larger noise of position or of the parameters.",
    ),
    "blind": _note("Samples lacked a measurement and were predicted only.", "Nothing, where they are few."),
}

_RECORD = {
    "invalid": _note("A stream has readings that are marked invalid.", "Look at the sensor, where they are many."),
    "duplicates": _note("Time-stamps of a stream are repeated.", "Look at the recording, where they are many."),
    "backwards": _doubtful(
        "The time of a stream goes backwards.", 'Use another clock, such as time = "log", or record again.'
    ),
    "gaps": _note("Readings of a stream are missing.", "Look at the recording, where they are many."),
    "saturated": _doubtful("Readings are at the limit of the sensor's range.", "Press less deep, or change the range."),
    "stuck": _doubtful(
        "A stream repeats exactly one reading for long.", "Look at sensor and driver; record at the true rate."
    ),
    "missing-force": _note("Samples have no force.", "Look at the force's stream, where they are many."),
    "missing-velocity": _note("Samples have no velocity.", "Look at the velocity's stream, where they are many."),
    "velocity-late": _doubtful(
        "The velocity lags the position: filtered (a mean of n samples is late by (n - 1)/2), or of another clock.",
        "Declare the velocity's delay in [alignment], or leave the velocity out.",
    ),
    "clock-drift": _doubtful(
        "The time-stamps of force and motion gain on one another over the record.",
        'Use one clock for both, such as time = "log".',
    ),
    "clock-wander": _doubtful(
        "The clock of a device strayed by more than the timing's declared uncertainty.",
        "Keep the machine for the rig, or declare a larger uncertainty in [alignment].",
    ),
    "payload": _note(
        "The payload that the robot counts on, or its centre of mass, is not what hangs on it.",
        "Set payload and payload_centre of the arm, or correct them on the pendant.",
    ),
    "no-tare": _doubtful(
        "The record has too little free air for the tare that is asked for.",
        "Record half a second of free air first, or give the tare as a force.",
    ),
    "untared": _doubtful("Before the first touch the force is not zero.", 'Set tare = "free-air", or tare the sensor.'),
    "touched-again": _note("Contact was lost and found again.", "Nothing, unless one contact was meant."),
    "backlog": _note(
        "Estimates of a live run came more than a second after their readings, or end before the record does.",
        "Use fewer or faster tracks, or a less busy computer; a replay of the log makes all estimates.",
    ),
    "ended-early": _doubtful(
        "A device that no safety check needs ended its stream while an arm still moved.",
        "Look at the device and its driver; what it would have sent is missing.",
    ),
    "interrupted": _note("The run was stopped before its end.", "`palpate resume` does what was left."),
    "rehearsal": _note(
        "The run is a rehearsal in simulated time: twin and specimen in software, nothing was measured.",
        "`palpate run` measures; what the specimen of the rehearsal was is under run.rehearsal of result.json.",
    ),
    "renamed": _note(
        "The pipeline uses a name of an older version, which was read as the one of today.",
        'Rename it as the message says, and state palpate = "0.2" at the top of the file.',
    ),
    "device": _note("A device or log has something to say of itself.", "Read the message."),
}

_PIPELINE = {
    "assumed": _doubtful(
        "The result rests on assumed values, such as a tip's radius that a suggestion has put in.",
        "Correct them in the pipeline and take them out of [run] assumed, or state them with --set.",
    ),
}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """What the core's own flags mean."""
    return {**_ESTIMATE, **_RECORD, **_PIPELINE}
