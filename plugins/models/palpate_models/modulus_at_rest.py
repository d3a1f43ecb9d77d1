"""The modulus at rest of a material that may still relax when the record ends: what the record leaves open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence

from palpate_models.relaxing_models import RelaxingModel

_MIN_SEPARATION = 3.0  # a choice: the next time of a spectrum is at least so many times the longest one found
_MAX_SEPARATION = 5.0  # a choice: and at most so many times
_UNSEEN_PARTS = 3.0  # a choice: parts as strong as the slowest one that may fade after the record
_MIN_SHARE = 0.01  # of the modulus at rest, a choice: a weaker part does not count


def at_rest(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return a flag for each model with relaxation times whose slowest part does not fade well within the record.

    Arms in parallel imitate any fading for as long as a record lasts, and call at rest what has not faded then.
    The next time, as far beyond the longest as that is beyond the one before (3 to 5 times), has to be within the
    record, or its fading would not have been seen: then between nothing and three more parts as strong as the
    slowest, at most all of the modulus, may still fade, a rectangular distribution. The keys are the tracks' names.
    """
    diagnoses = {}
    for track in tracks:
        used_times = track.kept.time[track.kept.used]
        if isinstance(track.model, RelaxingModel) and len(used_times):
            diagnosis = _diagnosis(track, track.model, float(np.ptp(used_times)))
            if diagnosis is not None:
                diagnoses[track.name] = diagnosis
    return diagnoses


def _diagnosis(track: TrackEvidence, model: RelaxingModel, span: float) -> Diagnosed | None:
    """Return the flag and the uncertainty of the modulus at rest for a record of a span [s]; None where all fades."""
    # The relaxation by the track's values: a lasting modulus [Pa], and arms of a strength [Pa] and a rate [1/s].
    law = model.spectrum(track.values.tolist())
    times = [parameter.name for parameter in model.parameters if parameter.unit == "s"]
    modulus_name = next((p.name for p in model.parameters if p.role == "elastic"), None)
    if law.lasting is None or modulus_name is None or len(times) != len(law.arms):
        return None
    arms = sorted((1.0 / rate, strength) for strength, rate in law.arms if strength > _MIN_SHARE * law.lasting)
    if not arms:
        return None
    # The next time would be as far beyond the slowest as that is beyond the one before.
    slowest, strength = arms[-1]
    separation = _MIN_SEPARATION
    if len(arms) > 1:
        separation = float(np.clip(slowest / arms[-2][0], _MIN_SEPARATION, _MAX_SEPARATION))
    if separation * slowest <= span:
        return None
    # A rectangular distribution from 0 to a has a standard deviation of a/sqrt(12) about its middle; the value stands
    # at its end, so that a/sqrt(3) is the root of its mean square.
    uncertainty = float(min(_UNSEEN_PARTS * strength, law.lasting) / np.sqrt(3.0))
    text = (
        f"{modulus_name} is that at rest, and the slowest part found, {strength:.3g} Pa, fades in {slowest:.3g} s of a "
        f"record of {span:.3g} s: what fades more slowly is in it, which counts {uncertainty:.2g} Pa"
    )
    return Diagnosed(
        (Flag("still-fading", text, effects={modulus_name: uncertainty}),),
        {modulus_name: uncertainty},
        table={"slowest": slowest, "span": span},
    )
