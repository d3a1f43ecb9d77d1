"""What a ball would give where a model has a sphere by its paraboloid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate import Condition, ConfigurationError, ContactModel, Diagnosed, Floats, TrackEvidence
from palpate_kit.budget.force_sensitivity import along

from palpate_models.indenters.power_profiles import Sphere
from palpate_models.indenters.spheres import ExactSphere

SHALLOW = 0.1  # of the radius: up to there the force of a ball is within 1 % of that of its paraboloid
_REMEDY = 'type = "exact-sphere"'


def ball_alternative(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the condition of every track with `sphere` whose record is deeper than a tenth of the radius.

    The pipeline states the law, so that no value is doubtful by it; the words of the condition have the ball's values.
    A simulated contact follows the law itself, and has no condition.
    """
    conditions = {track.name: _condition(track) for track in tracks}
    return {name: Diagnosed(conditions=(one,)) for name, one in conditions.items() if one is not None}


def _condition(track: TrackEvidence) -> Condition | None:
    tip, end = getattr(track.model, "indenter", None), track.ending
    if not isinstance(tip, Sphere) or end is None or end.is_simulated:
        return None
    if not float((end.last.surface - end.last.position).max()) > SHALLOW * tip.radius:
        return None
    shifts = _shifts(track, tip)
    if shifts is None:
        return None
    parameters = track.model.parameters
    table = {p.name: shift for p, shift in zip(parameters, shifts.tolist(), strict=True)}
    values = zip(parameters, track.values.tolist(), strict=True)
    elastic = {p.name: table[p.name] / value for p, value in values if p.role == "elastic" and value}
    if not elastic:
        return None
    words = ", ".join(f"{name} {100 * share:.0f} % higher" for name, share in elastic.items())
    return Condition("tip", f"the tip is a paraboloid (a ball: {words})", _REMEDY, shifts=table)


def _shifts(track: TrackEvidence, tip: Sphere) -> Floats | None:
    """Shift (k,) of the values by which a ball has the force of the paraboloid; None where that is not determined."""
    end, ball = track.ending, _on_a_ball(track.model, tip)
    if ball is None or end is None:
        return None
    model_force = along(track.model, end.tail, end.last, track.values)
    ball_force = along(ball, end.tail, end.last, track.values)
    if model_force is None or ball_force is None:
        return None
    return ball_force.shifts(model_force.force - ball_force.force)


def _on_a_ball(model: ContactModel, tip: Sphere) -> ContactModel | None:
    """The model with the exact sphere; None where a correction of it is for the paraboloid alone."""
    fields = {key: getattr(model, key) for key in type(model).model_fields}
    try:
        return type(model)(**{**fields, "indenter": ExactSphere(radius=tip.radius)})
    except ConfigurationError:
        return None
