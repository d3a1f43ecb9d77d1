"""A force that was zeroed in contact: the air that gave the zero lies below the surface that a track finds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from palpate import Flag, Floats, TrackEnd, TrackEvidence, contact_force
from palpate_kit.budget.influence import effects_by_name
from palpate_kit.terminal.phrase import Quantity, quantity_text

from palpate_uncertainty.alternative_fit import Refit, refit
from palpate_uncertainty.refit import Course, make_course, possible
from palpate_uncertainty.refitted_model import judged_rows

# Choices. They apply where the tare was taken below the surface that the fit finds.
SIGNIFICANT = 5.0  # standard uncertainties of the force that is missing where the zero was taken
FEWEST_READINGS = 10  # of the tare
DEPTH_STEP = 1e-6  # [m] for a slope
MAX_REFITS = 8  # until the zero has settled
SETTLED = 0.02  # of the zero, by which it changes from one refit to the next


def zeroed_in_contact(track: TrackEvidence, end: TrackEnd) -> Iterator[Flag]:
    """Yield the flag of a zero that was taken where the model has a force; `end` has the report on that zero.

    A tip that is at depth d when the force is zeroed reads F(d) too little ever after; the fitted surface is below the
    real one and still above the tip.
    """
    tare = end.report.tare
    if tare is None or tare.until is None or track.model.adhesive or track.model.memory or not possible(track):
        return
    rows = (track.air_time <= tare.until) & np.isfinite(track.air_force) & np.isfinite(track.air_position)
    if np.count_nonzero(rows) < FEWEST_READINGS:
        return
    # The model's force where the zero was taken, and its uncertainty by tare and surface.
    height = float(np.median(track.air_position[rows]))
    depth = track.surface - height
    force = _force_at(track, track.values, depth)
    slope = (_force_at(track, track.values, depth + DEPTH_STEP) - force) / DEPTH_STEP
    error = float(np.hypot(tare.offset_std or 0.0, slope * float(end.last.surface_std[-1])))
    missing = force - float(np.mean(track.air_force[rows]))
    if depth <= 0 or not missing > SIGNIFICANT * error:
        return
    place = quantity_text(Quantity(depth, "m", 2))
    text = f"the zero was taken {place} below the estimated surface, where the model has {missing:.2g} +- {error:.1g} N"
    yield Flag("zeroed-in-contact", text, effects=effects_by_name(track.model, _shifts_without(track, height)))


def _shifts_without(track: TrackEvidence, height: float) -> Floats | None:
    """Return the shifts of the values (k,) if the force was zeroed while the tip pressed at a height [m].

    The zero is then the force of the model at that height, and the model is fitted to the readings with that zero
    added: a fixed point, found by secants. None where no sample is judged, or the iterations do not settle.
    """
    course = make_course(track, judged_rows(track))
    if not course.used.any():
        return None
    zeros, forces = [0.0], list[float]()
    for _ in range(MAX_REFITS):
        fit = _refit_with_zero(track, course, zeros[-1])
        forces.append(_force_at(track, fit.theta, fit.surface - height))
        if abs(forces[-1] - zeros[-1]) <= SETTLED * abs(forces[-1]):
            return np.asarray(fit.theta - track.values)
        zeros.append(_next_zero(zeros, forces))
    return None


def _next_zero(zeros: list[float], forces: list[float]) -> float:
    """Return the zero [N] at which the line through the last two forces meets it; the last force before that."""
    if len(forces) < 2:
        return forces[-1]
    gain = (forces[-1] - forces[-2]) / (zeros[-1] - zeros[-2])
    return zeros[-1] + (forces[-1] - zeros[-1]) / (1.0 - gain) if gain < 1.0 else forces[-1]


def _refit_with_zero(track: TrackEvidence, course: Course, zero: float) -> Refit:
    """Return the refit to the force with a zero [N] added."""
    return refit(replace(course, force=course.force + zero), track.values, track.surface)


def _force_at(track: TrackEvidence, theta: Floats, depth: float) -> float:
    """Return the force [N] of the model at rest at a depth [m]; 0 above the surface."""
    return float(np.ravel(contact_force(track.model, np.array([max(depth, 0.0)]), 0.0, theta.tolist()))[0])
