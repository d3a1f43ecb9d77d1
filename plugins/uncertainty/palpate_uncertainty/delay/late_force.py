"""The effect of a late force on an estimate that does not know it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEnd, TrackEvidence
from palpate_kit.budget.force_sensitivity import along

from palpate_uncertainty.delay.passivity import force_lateness
from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous


def late_force(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track whose contact does net work.

    No viscosity of it is known, and the other values are shifted by at least that delay. Beyond what the work shows,
    the force may be late by as much as the material's own eta/G, which is not known then.
    """
    findings = {}
    for track in tracks:
        end = track.ending
        if end is None or end.is_sweep:
            continue
        lateness = force_lateness(end.tail, track.tip_mass or 0.0)
        if lateness is not None:
            findings[track.name] = _finding(track, end, lateness)
    return findings


def _finding(track: TrackEvidence, end: TrackEnd, lateness: float) -> Diagnosed:
    """Return the shifts of all values by a force that is late by at least so many seconds."""
    text = f"the contact does net work: the force is at least {1e3 * lateness:.2g} ms late"
    if not np.isfinite(track.values).all():
        text += ", which is likely why the estimates diverged: the viscosity would be negative"
        return Diagnosed((Flag("force-late", text),))
    sensitivity = along(track.model, end.tail, end.last, track.values, end.held)
    shifts = np.abs(lateness * delay_shifts(track.model, sensitivity, track.values)).tolist()
    viscous = frozenset(parameter.name for parameter in track.model.parameters if is_viscous(parameter))
    terms: dict[str, float] = {}
    for parameter, shift in zip(track.model.parameters, shifts, strict=True):
        if parameter.name not in viscous and shift > 0:
            terms[parameter.name] = shift
    flag = Flag("force-late", text, effects=terms | dict.fromkeys(sorted(viscous), math.inf))
    return Diagnosed((flag,), terms=terms, unknown=viscous)
