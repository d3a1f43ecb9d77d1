"""Assumptions of a result: every number without a declared uncertainty, and the effect of 1 % of it."""

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

SHARE = 0.01  # of an assumption, and of a value
_DIFFERENCE = 1e-4  # of a number, for derivatives by differences


def assumptions(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track what its values assume to be exact, and by how many per cent 1 % of each moves each value.

    A small error f(t) of the force shifts the least-squares estimate with unknown surface by (J^T J)^-1 J^T f, as in
    the budget: f = 0.01 F for the gain of the force, -0.01 (dF/dd d + dF/dd' d') for the scale of the height,
    -dF/dp 0.01 p for a number p of the model. What is declared with an uncertainty stands in the budget, and not here.
    """
    tables = {track.name: _of(track, track.ending) for track in tracks if track.ending is not None}
    return {name: Diagnosed(table=table) for name, table in tables.items() if table}


def _of(track: TrackEvidence, end: TrackEnd) -> dict[str, Any]:
    found = along(track.model, end.tail, end.last, track.values, end.held)
    if found is None:
        return {}
    percent = {
        name: shares
        for name, path, error in _errors(found, end.uncertainties)
        if (shares := _percent(found, error, path))
    }
    if not percent:
        return {}
    table: dict[str, Any] = {"percent": percent}
    if end.settings.series_stiffness is None and found.given_way is not None:
        shares = _percent(found, -found.given_way)  # per m/N
        table["rigid_above"] = {name: abs(share) / (100.0 * SHARE) for name, share in shares.items()}
    if (thick := half_space_from(track)) is not None:
        table["half_space_above"] = thick
    table |= _of_the_skin(track)
    used = track.kept.used & np.isfinite(track.kept.position)
    rhythm = oscillation(track.kept.time[used], track.kept.position[used])
    if rhythm is not None and any(is_viscous(parameter) for parameter in track.model.parameters):
        table["frequency"] = float(rhythm[0])
    return table


def _of_the_skin(track: TrackEvidence) -> dict[str, Any]:
    """Return the inclination [rad], and the radius [m] of a skin, that move an elasticity by 1 %.

    Nothing where the skin is stated, or a surface says what it is.

    A tip that slides on an inclination t has cos(t)^(p + 1) of the force, p the power d a/A of the depth that it goes
    with; a curvature k of the skin adds k r^2/2 to the profile of the tip, and takes k a^3/3 from its area A.
    """
    tip, depth = getattr(track.model, "indenter", None), depths_in_contact(track)
    if "skin" not in type(track.model).model_fields or not isinstance(tip, Indenter) or not len(depth):
        return {}
    over_a_surface = track.ending is not None and track.ending.settings.surface is not None
    if getattr(track.model, "skin", None) is not None or over_a_surface:
        return {"skin_stated": True}
    mean = float(np.mean(depth))
    radius, area = float(tip.contact_radius(mean)), float(tip.profile_area(mean))
    level = math.acos((1.0 - SHARE) ** (1.0 / (1.0 + mean * radius / area)))
    return {"level_within": level, "flat_above": radius**3 / (3.0 * SHARE * area)}


def _errors(found: Along, declared: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...], Floats]]:
    """Name, path of the model's key, and error (n,) [N] of the force by 1 % of everything that is not declared."""
    if "force_scale" not in declared:
        yield "force_scale", (), SHARE * found.force
    if "position_scale" not in declared:
        yield "position_scale", (), -SHARE * found.by_height_scale()
    for path, value, _ in numbers_of(found.model):
        if value and math.isfinite(value) and not {".".join(path), path[-1]} & declared.keys():
            yield ".".join(path), path, -SHARE * value * found.by_number(path, value)


def _percent(found: Along, error: Floats, path: tuple[str, ...] = ()) -> dict[str, float]:
    """By how many per cent of it an error (n,) [N] of the force moves each value; a number of the model by itself, too.

    With signs; nothing where parameters and surface are indistinct.
    """
    shifts = found.answer(error)
    if shifts is None:
        return {}
    model, theta = found.model, found.values.tolist()
    moved = {p.name: (shift, value) for p, shift, value in zip(model.parameters, shifts.tolist(), theta, strict=False)}
    direct = _direct(model, theta, path) if path else {}
    for material in model.material(theta):
        shift = float(np.array(material.gradient) @ shifts[:-1]) + direct.get(material.name, 0.0)
        moved[material.name] = (shift, material.value)
    return {name: 100.0 * shift / abs(value) for name, (shift, value) in moved.items() if value}


def _direct(model: ContactModel, theta: Sequence[float], path: tuple[str, ...]) -> dict[str, float]:
    """By how much 1 % of a number moves what follows from the parameters, with these held [SI]."""
    value = next(value for other, value, _ in numbers_of(model) if other == path)
    up, down = (
        {m.name: m.value for m in with_change(model, path, side * _DIFFERENCE * value).material(theta)}
        for side in (1.0, -1.0)
    )
    return {name: (up[name] - down[name]) / (2 * _DIFFERENCE) * SHARE for name in up}
