"""Surface mismatch: an estimated surface that is not where the tip first touched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, Floats, TrackEnd, TrackEvidence, contact_force
from palpate_kit.budget.force_sensitivity import along
from palpate_kit.budget.influence import answer

SURFACE_TOLERANCE = 5e-4  # [m] within which a first touch on rough skin may be (choice)
CHANCE_DEVIATIONS = 2.0  # standard uncertainties of the surface: a shorter distance may be chance, 95 % (choice)
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
    ending, model = track.ending, track.model
    # The force of a material that relaxes at a first touch depends on the approach.
    if ending is None or ending.report.first_touch is None or ending.report.tare is None or model.memory:
        return None
    if ending.report.tare.noise is None:
        return None
    _, touch_height = ending.report.first_touch
    distance = _distance(track, ending, noise=ending.report.tare.noise, touch_height=touch_height)
    if abs(distance) <= max(SURFACE_TOLERANCE, CHANCE_DEVIATIONS * track.surface_uncertainty):
        return None
    text = f"the estimated surface is {1e3 * distance:+.2f} mm from where the tip touched"
    if distance < 0:  # below it: something else moves the force in air
        text = f"{text}, so that the force changes in air"
    # The effect: the parameters' answer to the change of the force by a surface that is held at the touch.
    estimate = ending.last.values.mean(axis=0)
    sensitivity = along(model, tail=ending.tail, last=ending.last, values=estimate, held=ending.held)
    effects = None
    if sensitivity is not None:
        by_parameters, by_surface = sensitivity.jacobian[:, :-1], sensitivity.jacobian[:, -1]
        shifts = answer(by_parameters, distance * by_surface)
        if shifts is not None:
            names = [parameter.name for parameter in model.parameters]
            effects = dict(zip(names, np.abs(shifts).tolist(), strict=True))
    return Flag("surface-mismatch", text, effects=effects)


def _distance(track: TrackEvidence, ending: TrackEnd, noise: float, touch_height: float) -> float:
    """Return the distance [m] of the surface from the heights at which the first touch may have been, 0 within them.

    `ending` has the report on the first touch and the latest estimates. A change point notices the contact between no
    force and the noise [N]; without one it is noticed where the force passes the threshold.
    """
    if ending.report.by_change_point:
        least_force, largest_force = 0.0, noise
    else:
        least_force = largest_force = ending.report.touch_force
    # The depths at which the model's force reaches those of the first touch.
    force = contact_force(track.model, DEPTHS, 0.0, ending.last.values.mean(axis=0))
    shallowest, deepest = _depth_of_force(force, least_force), _depth_of_force(force, largest_force)
    touch_depth = float(ending.last.surface.mean()) - touch_height
    return touch_depth - min(max(touch_depth, shallowest), deepest)


def _depth_of_force(force: Floats, limit: float) -> float:
    """Return the first of `DEPTHS` [m] at which a force (n,) [N] over them reaches a limit [N], else the last one."""
    return float(DEPTHS[min(int(np.searchsorted(force, limit)), len(DEPTHS) - 1)])
