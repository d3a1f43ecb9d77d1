"""The values by a ball, where a model has a sphere by its paraboloid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate import Condition, ConfigurationError, ContactModel, Diagnosed, Floats, TrackEvidence
from palpate_kit.budget.force_sensitivity import along, alternative_along

from palpate_models.indenters.power_profiles import Sphere
from palpate_models.indenters.spheres import ExactSphere

SHALLOW = 0.1  # of the radius: a ball's force is d/(10 R) below that of its paraboloid, so 1 % there
_REMEDY = 'type = "exact-sphere"'


def ball_alternative(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the condition of every track with `sphere` whose record is deeper than a tenth of the radius.

    The pipeline states the law, so that no value is doubtful by it; the words of the condition have the ball's values.
    A simulated contact follows the law itself, and has no condition.
    """
    conditions = {track.name: _condition(track) for track in tracks}
    return {name: Diagnosed(conditions=(condition,)) for name, condition in conditions.items() if condition is not None}


def _condition(track: TrackEvidence) -> Condition | None:
    """Return the condition of a track with the shares of its elastic values; None where a ball makes no difference.

    It makes one where the tip is a paraboloid, and deeper than a share of its radius in the samples of the result.
    """
    tip, end = getattr(track.model, "indenter", None), track.ending
    if not isinstance(tip, Sphere) or end is None or end.is_simulated:
        return None
    if not float((end.last.surface - end.last.position).max()) > SHALLOW * tip.radius:
        return None
    shifts = _shifts(track, tip)
    if shifts is None:
        return None
    # The sentence has the elastic values alone: a paraboloid hardly changes a viscosity.
    shift_of, elastic = {}, []
    for parameter, value, shift in zip(track.model.parameters, track.values.tolist(), shifts.tolist(), strict=True):
        shift_of[parameter.name] = shift
        if parameter.role == "elastic" and value:
            elastic.append(f"{parameter.name} {100 * (shift / value):.0f} % higher")
    if not elastic:
        return None
    return Condition("tip", f"the tip is a paraboloid (a ball: {', '.join(elastic)})", _REMEDY, shifts=shift_of)


def _shifts(track: TrackEvidence, tip: Sphere) -> Floats | None:
    """Return the shift (k,) of the values by which a ball has the paraboloid's force; None where undetermined."""
    end, ball = track.ending, _on_a_ball(track.model, tip)
    if ball is None or end is None:
        return None
    model_force = along(track.model, end.tail, end.last, track.values, end.held)
    ball_force = alternative_along(ball, end.tail, end.last, track.values, end.held)
    if model_force is None or ball_force is None:
        return None
    return ball_force.shifts(model_force.force - ball_force.force)


def _on_a_ball(model: ContactModel, tip: Sphere) -> ContactModel | None:
    """Return the model with the exact sphere; None where one of its corrections is for the paraboloid alone."""
    fields = {key: getattr(model, key) for key in type(model).model_fields}
    try:
        return type(model)(**{**fields, "indenter": ExactSphere(radius=tip.radius)})
    except ConfigurationError:
        return None
