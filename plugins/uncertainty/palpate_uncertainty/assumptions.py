"""Assumptions of a result: every number without a declared uncertainty, and the effect of 1 % of each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from palpate import ContactModel, Diagnosed, Floats, Indenter, TrackEnd, TrackEvidence
from palpate_engine import numbers_of
from palpate_kit.budget.force_sensitivity import Along, along, with_change

from palpate_uncertainty.delay.timing_shift import is_viscous
from palpate_uncertainty.refit import depths_in_contact
from palpate_uncertainty.undeclared_thickness import half_space_from
from palpate_uncertainty.whiteness import oscillation

SHARE = 0.01  # of an assumption, and of a value: the 1 % of the sentence
_DIFFERENCE = 1e-4  # of a number, for derivatives by differences (choice)


def assumptions(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return, of each track, the numbers that its values assume to be exact, and the effect of 1 % of each.

    A small error f(t) of the force shifts the least-squares estimate with unknown surface by (J^T J)^-1 J^T f, as in
    the budget: f = 0.01 F for the gain of the force, -0.01 (dF/dd d + dF/dd' d') for the scale of the height,
    -dF/dp 0.01 p for a number p of the model. A number with a declared uncertainty is in the budget, and not here.
    """
    tables = {track.name: _table(track, track.ending) for track in tracks if track.ending is not None}
    return {name: Diagnosed(table=table) for name, table in tables.items() if table}


def _table(track: TrackEvidence, end: TrackEnd) -> dict[str, Any]:
    """Return the assumptions of one track; empty if it has no sensitivity to any of them.

    `end` has the settings and the latest estimates of the track, by which the force's derivatives are taken. `percent`
    has, by assumption and value, the change of the value by 1 % of the assumed number.
    """
    sensitivity = along(track.model, end.tail, end.last, track.values, end.held)
    if sensitivity is None:
        return {}
    # The effect of 1 % of each number that is taken as exact.
    percent = {}
    for name, path, error in _errors(sensitivity, end.uncertainties):
        shares = _percent(sensitivity, error, path)
        if shares:
            percent[name] = shares
    if not percent:
        return {}
    table: dict[str, Any] = {"percent": percent}
    # The stiffness k of the robot above which the values change by less than 1 %: its compliance 1/k changes them by
    # share/k per cent. The same for the thickness of the specimen (5 %), and the shape of the skin.
    if end.settings.series_stiffness is None and sensitivity.given_way is not None:
        shares = _percent(sensitivity, -sensitivity.given_way)  # per m/N
        table["rigid_above"] = {name: abs(share) / (100.0 * SHARE) for name, share in shares.items()}
    thickness = half_space_from(track)
    if thickness is not None:
        table["half_space_above"] = thickness
    table |= _of_the_skin(track)
    # The frequency at which a viscosity was seen.
    used = track.kept.used & np.isfinite(track.kept.position)
    rhythm = oscillation(track.kept.time[used], track.kept.position[used])
    if rhythm is not None and any(is_viscous(parameter) for parameter in track.model.parameters):
        frequency, _ = rhythm
        table["frequency"] = float(frequency)
    return table


def _of_the_skin(track: TrackEvidence) -> dict[str, Any]:
    """Return the inclination [rad], and the radius [m] of a skin, that move an elasticity by 1 %.

    Where the pipeline states the skin or a surface, the table only says so.

    A tip that slides on an inclination t has cos(t)^(p + 1) of the force, which is proportional to d^p: p = d a/A, a
    the contact radius and A the profile area. A curvature k of the skin adds k r^2/2 to the profile of the tip, and
    takes k a^3/3 from its area A.
    """
    tip, depth = getattr(track.model, "indenter", None), depths_in_contact(track)
    if "skin" not in type(track.model).model_fields or not isinstance(tip, Indenter) or not len(depth):
        return {}
    has_surface = track.ending is not None and track.ending.settings.surface is not None
    if getattr(track.model, "skin", None) is not None or has_surface:
        return {"skin_stated": True}
    mean = float(np.mean(depth))
    radius, area = float(tip.contact_radius(mean)), float(tip.profile_area(mean))
    level = math.acos((1.0 - SHARE) ** (1.0 / (1.0 + mean * radius / area)))
    return {"level_within": level, "flat_above": radius**3 / (3.0 * SHARE * area)}


def _errors(sensitivity: Along, declared: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...], Floats]]:
    """Yield name, path of the model's key, and error (n,) [N] of the force by 1 % of each undeclared number."""
    if "force_scale" not in declared:
        yield "force_scale", (), SHARE * sensitivity.force
    if "position_scale" not in declared:
        yield "position_scale", (), -SHARE * sensitivity.by_height_scale()
    for path, value, _ in numbers_of(sensitivity.model):
        if value and math.isfinite(value) and not {".".join(path), path[-1]} & declared.keys():
            yield ".".join(path), path, -SHARE * value * sensitivity.by_number(path, value)


def _percent(sensitivity: Along, error: Floats, path: tuple[str, ...] = ()) -> dict[str, float]:
    """Return by how many per cent an error (n,) [N] of the force moves each value, with its sign.

    `sensitivity` has the derivatives of the model's force at the estimate. `path` are the keys of the number of the
    model that is in error, if it is one: what is derived from the parameters, such as a modulus, also depends on this
    number itself. Empty where the samples do not distinguish parameters and surface.
    """
    shifts = sensitivity.answer(error)
    if shifts is None:
        return {}
    model, theta = sensitivity.model, sensitivity.values.tolist()
    moved = {}
    for parameter, shift, value in zip(model.parameters, shifts.tolist(), theta, strict=False):
        moved[parameter.name] = (shift, value)
    direct = _direct(model, theta, path) if path else {}
    for material in model.material(theta):
        shift = float(np.array(material.gradient) @ shifts[:-1]) + direct.get(material.name, 0.0)
        moved[material.name] = (shift, material.value)
    return {name: 100.0 * shift / abs(value) for name, (shift, value) in moved.items() if value}


def _direct(model: ContactModel, theta: Sequence[float], path: tuple[str, ...]) -> dict[str, float]:
    """Return by how much [SI] 1 % of a number moves what follows from the parameters, with these held."""
    value = next(value for other, value, _ in numbers_of(model) if other == path)
    up, down = (
        {m.name: m.value for m in with_change(model, path, side * _DIFFERENCE * value).material(theta)}
        for side in (1.0, -1.0)
    )
    return {name: (up[name] - down[name]) / (2 * _DIFFERENCE) * SHARE for name in up}
