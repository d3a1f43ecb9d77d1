"""What a record determines of the modulus at rest, where the material may still fade when the record ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence

from palpate_models.relaxing_models import RelaxingModel

_APART = (3.0, 5.0)  # by how much at least, and at most, the next time of a spectrum is taken to be longer
_MORE = 3.0  # parts as strong as the slowest that may fade after the record
_NOTHING = 0.01  # of the modulus at rest; a part below it does not count


def at_rest(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of models whose relaxation times are parameters: whether the slowest part found fades well within the record.

    Arms in parallel imitate any fading for as long as a record lasts, and call at rest what has not faded then.
    The next time, as far beyond the longest as that is beyond the one before (3 to 5 times), has to be within the
    record, or what fades with it would not have been seen: then between nothing and three more parts as strong as the
    slowest, at most all of the modulus, may still fade, a rectangular distribution.
    """
    found = {}
    for track in tracks:
        used = track.kept.time[track.kept.used]
        if isinstance(track.model, RelaxingModel) and len(used):
            judged = _judged(track, track.model, float(np.ptp(used)))
            if judged is not None:
                found[track.name] = judged
    return found


def _judged(track: TrackEvidence, model: RelaxingModel, span: float) -> Diagnosed | None:
    law = model.spectrum(track.values.tolist())
    times = [parameter.name for parameter in model.parameters if parameter.unit == "s"]
    lasting = next((p.name for p in model.parameters if p.role == "elastic"), None)
    if law.lasting is None or lasting is None or len(times) != len(law.arms):
        return None
    arms = sorted((1.0 / rate, strength) for strength, rate in law.arms if strength > _NOTHING * law.lasting)
    if not arms:
        return None
    slowest, strength = arms[-1]
    apart = float(np.clip(slowest / arms[-2][0], *_APART)) if len(arms) > 1 else _APART[0]
    if apart * slowest <= span:
        return None
    share = min(_MORE * strength, law.lasting) / np.sqrt(3.0)
    text = (
        f"{lasting} is that at rest, and the slowest part found, {strength:.3g} Pa, fades in {slowest:.3g} s of a "
        f"record of {span:.3g} s: what fades more slowly is in it, which counts {share:.2g} Pa"
    )
    share = float(share)
    return Diagnosed(
        (Flag("still-fading", text, effects={lasting: share}),),
        {lasting: share},
        table={"slowest": slowest, "span": span},
    )
