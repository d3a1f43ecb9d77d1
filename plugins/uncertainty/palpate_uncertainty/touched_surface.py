"""Surface mismatch: an estimated surface that is not where the tip first touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence, contact_force
from palpate_kit.budget.force_sensitivity import along
from palpate_kit.budget.influence import answer

SURFACE_TOLERANCE = 5e-4  # m; within which a first touch on rough skin may be
EXPLAINED = 2.0  # standard uncertainties of the surface, that a distance is not a contradiction within
DEPTHS = np.linspace(0.0, 0.02, 2001)  # [m] over which the force of first touch is looked up


def touched_surface(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track whose surface is not where the tip first touched."""
    findings = {}
    for track in tracks:
        try:
            flag = surface_mismatch(track)
        except Exception as error:  # of a model that cannot say more than its force: the other tracks are judged
            flag = Flag("diagnosis-failed", f"touched-surface: {type(error).__name__}: {error}")
        if flag is not None:
            findings[track.name] = Diagnosed((flag,))
    return findings


def surface_mismatch(track: TrackEvidence) -> Flag | None:
    """Return the flag of one track; None where the surface agrees with the first touch, or nothing shows one.

    The model at the estimate must give the force of first touch where that was; none, where contact began there. The
    effect is what least squares would give if the surface were held there.
    """
    end, model = track.ending, track.model
    # What a material that relaxes answers to a first touch depends on the approach.
    if end is None or end.report.first_touch is None or end.report.tare is None or model.memory:
        return None
    if end.report.tare.noise is None:
        return None
    theta, surface = end.last.values.mean(axis=0), float(end.last.surface.mean())
    force = contact_force(model, DEPTHS, 0.0, theta)
    # Where contact began is noticed between none and the noise, else where the force passes a threshold.
    limits = (0.0, end.report.tare.noise) if end.report.by_change_point else (end.report.touch_force,) * 2
    least, most = (float(DEPTHS[min(int(np.searchsorted(force, limit)), len(DEPTHS) - 1)]) for limit in limits)
    below = surface - end.report.first_touch[1]
    distance = below - min(max(below, least), most)
    if abs(distance) <= max(SURFACE_TOLERANCE, EXPLAINED * track.surface_uncertainty):
        return None
    text = f"the estimated surface is {1e3 * distance:+.2f} mm from where the tip touched"
    if distance < 0:  # below it: something else moves the force in air
        text = f"{text}, so that the force changes in air"
    course = along(model, end.tail, end.last, theta, end.held)
    shifts = None if course is None else answer(course.jacobian[:, :-1], distance * course.jacobian[:, -1])
    names = [parameter.name for parameter in model.parameters]
    effects = None if shifts is None else dict(zip(names, np.abs(shifts).tolist(), strict=True))
    return Flag("surface-mismatch", text, effects=effects)
