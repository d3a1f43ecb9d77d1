"""The effect of a late force on an estimate that does not know it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence
from palpate_kit.budget.force_sensitivity import along

from palpate_uncertainty.delay.passivity import force_lateness
from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous


def late_force(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """For every track whose contact does net work: no viscosity is known, the rest is shifted by at least that delay.

    How late the force is beyond what shows in the work is as long as the material's own eta/G, which is not known then.
    """
    found = {}
    for track in tracks:
        end = track.ending
        late = force_lateness(end.tail, track.tip_mass or 0.0) if end is not None and not end.is_sweep else None
        if end is None or late is None:
            continue
        said = f"the contact does net work: the force is at least {1e3 * late:.2g} ms late"
        if not np.isfinite(track.values).all():
            said += ", which is likely why the estimates diverged: the viscosity would be negative"
            found[track.name] = Diagnosed((Flag("force-late", said),))
            continue
        shifts = delay_shifts(track.model, along(track.model, end.tail, end.last, track.values, end.held), track.values)
        parts = list(zip(track.model.parameters, np.abs(late * shifts).tolist(), strict=True))
        viscous = frozenset(parameter.name for parameter, _ in parts if is_viscous(parameter))
        terms = {parameter.name: shift for parameter, shift in parts if parameter.name not in viscous and shift > 0}
        flag = Flag("force-late", said, effects=terms | dict.fromkeys(sorted(viscous), math.inf))
        found[track.name] = Diagnosed((flag,), terms=terms, unknown=viscous)
    return found
