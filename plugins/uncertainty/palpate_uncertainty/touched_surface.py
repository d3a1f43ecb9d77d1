"""Surface mismatch: an estimated surface that is not where the tip first touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEnd, TrackEvidence, contact_force
from palpate_kit.budget.force_sensitivity import along
from palpate_kit.budget.influence import answer

SURFACE_TOLERANCE = 5e-4  # [m] within which a first touch on rough skin may be (choice)
EXPLAINED = 2.0  # standard uncertainties of the surface (choice), within which a distance agrees
DEPTHS = np.linspace(0.0, 0.02, 2001)  # [m] over which the force of first touch is looked up


def touched_surface(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track whose surface is not where the tip first touched."""
    findings = {}
    for track in tracks:
        try:
            flag = surface_mismatch(track)
        except Exception as error:  # of one model; the other tracks are judged all the same
            flag = Flag("diagnosis-failed", f"touched-surface: {type(error).__name__}: {error}")
        if flag is not None:
            findings[track.name] = Diagnosed((flag,))
    return findings


def surface_mismatch(track: TrackEvidence) -> Flag | None:
    """Return the flag of one track; None where the surface agrees with the first touch, or nothing shows one.

    The model at the estimate must give the force of first touch at its place. The effect is what least squares would
    give if the surface were held there.
    """
    end, model = track.ending, track.model
    # The force of a material that relaxes at a first touch depends on the approach.
    if end is None or end.report.first_touch is None or end.report.tare is None or model.memory:
        return None
    if end.report.tare.noise is None:
        return None
    distance = _distance(track, end, end.report.tare.noise, end.report.first_touch[1])
    if abs(distance) <= max(SURFACE_TOLERANCE, EXPLAINED * track.surface_uncertainty):
        return None
    text = f"the estimated surface is {1e3 * distance:+.2f} mm from where the tip touched"
    if distance < 0:  # below it: something else moves the force in air
        text = f"{text}, so that the force changes in air"
    sensitivity = along(model, end.tail, end.last, end.last.values.mean(axis=0), end.held)
    effects = None
    if sensitivity is not None:
        by_surface = distance * sensitivity.jacobian[:, -1]
        shifts = answer(sensitivity.jacobian[:, :-1], by_surface)
        if shifts is not None:
            names = [parameter.name for parameter in model.parameters]
            effects = dict(zip(names, np.abs(shifts).tolist(), strict=True))
    return Flag("surface-mismatch", text, effects=effects)


def _distance(track: TrackEvidence, end: TrackEnd, noise: float, touch_height: float) -> float:
    """Return the distance [m] of the surface from the heights at which the first touch may have been, 0 within them.

    A change point notices the contact between no force and the noise [N]; without one it is noticed where the force
    passes the threshold.
    """
    force = contact_force(track.model, DEPTHS, 0.0, end.last.values.mean(axis=0))
    limits = (0.0, noise) if end.report.by_change_point else (end.report.touch_force,) * 2
    shallowest, deepest = (float(DEPTHS[min(int(np.searchsorted(force, limit)), len(DEPTHS) - 1)]) for limit in limits)
    depth = float(end.last.surface.mean()) - touch_height
    return depth - min(max(depth, shallowest), deepest)
