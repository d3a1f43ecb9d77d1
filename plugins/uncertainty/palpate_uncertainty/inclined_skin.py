"""Whether the force across the tool is that of a skin as inclined as it is stated to be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Diagnosed, Flag, Floats, Indenter, TrackEnd, TrackEvidence
from palpate_kit.runs.uncertainty_sources import sources_of

from palpate_uncertainty.refit import depths_in_contact

_HERTZ = 1.5  # power of the depth that a force goes with under a sphere
_STEEPEST = math.radians(45.0)
_STEP = math.radians(0.05)
_SIGMAS = 5.0  # standard deviations of a share that is not by chance
_LEAST = 0.02  # share; the axes of a force sensor hear one another by so much
_WIDE = 2.0  # standard uncertainties of an inclination


def inclined_skin(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track whose record has the force's other axes: how inclined these say that the skin is.

    A press along the tool on a skin that is inclined by t against it has tan(t - phi) of the force sideways, phi the
    friction angle, tan(phi) at most m tan t where the tip sticks, m = 2 (1 - nu)/(2 - nu). So a share r stands for an
    inclination between arctan(r), of a tip that slides, and t with r = (1 - m) tan t/(1 + m tan^2 t), and no friction
    makes it less. A flag names what is beyond the stated inclination, or below it, with what it makes of the values.
    Of a sweep, friction along the way explains any share, and nothing is said.
    """
    found = {track.name: _of(track, track.ending) for track in tracks if track.ending is not None}
    return {name: diagnosed for name, diagnosed in found.items() if diagnosed is not None}


def _of(track: TrackEvidence, end: TrackEnd) -> Diagnosed | None:
    share, depth = end.report.sideways, depths_in_contact(track)
    if share is None or end.is_sweep or not len(depth) or not np.isfinite(track.values).all():
        return None
    model: Any = track.model
    drag = _drag(float(getattr(model, "poisson", 0.5)))
    angles = possible_inclinations(share.size, drag)
    table = {"share": share.size, "std": share.std, "inclinations": [float(angles[0]), float(angles[-1])]}
    low, high = _stated(model, end.uncertainties, float(np.mean(depth)))
    beyond = share.size - _SIGMAS * share.std > max(math.tan(high), _LEAST)
    below = share.size + max(_SIGMAS * share.std, _LEAST) < _sideways(low, drag)
    if not (beyond or below):
        return Diagnosed(table=table)
    power = _power(model, float(np.mean(depth)))
    stated = model.skin.stick * drag if getattr(model, "skin", None) is not None else 0.0
    own = math.cos(high if beyond else low)
    ratio = axial_ratio(share.size, angles, power) / (own ** (power + 1.0) * (1.0 + stated * (1.0 / own**2 - 1.0)))
    worst = float(np.max(np.abs(1.0 / ratio - 1.0)))
    effects = {
        p.name: worst * abs(value)
        for p, value in zip(model.parameters, track.values.tolist(), strict=True)
        if p.role is not None
    }
    first, last = np.degrees(angles[[0, -1]]).tolist()
    text = (
        f"{100 * share.size:.2g} % of the force is across the tool: the skin is inclined by {first:.2g} deg where the "
        f"tip slides, by up to {last:.2g} deg where friction holds it, and not by {_words(low, high)}"
    )
    return Diagnosed((Flag("inclined-skin", text, effects=effects, causes=("inclination", "stick")),), table=table)


def _words(low: float, high: float) -> str:
    if high == 0.0:
        return "0 as is assumed"
    return f"{math.degrees(low):.2g} to {math.degrees(high):.2g} deg as is stated"


def _drag(poisson: float) -> float:
    """Stiffness of a contact along the skin over that along the normal (Mindlin 1949)."""
    return 2.0 * (1.0 - poisson) / (2.0 - poisson)


def _sideways(angle: float, drag: float) -> float:
    """Share of the force that is sideways where the tip sticks."""
    return (1.0 - drag) * math.tan(angle) / (1.0 + drag * math.tan(angle) ** 2)


def possible_inclinations(share: float, drag: float) -> Floats:
    """Inclinations (n,) [rad], up to 45 degrees, that a sideways share of the force can come of."""
    angles = math.atan(share) + np.arange(0.0, _STEEPEST, _STEP)
    angles = angles[angles < _STEEPEST] if share < math.tan(_STEEPEST) else angles[:1]
    friction = np.tan(angles - math.atan(share))
    return np.asarray(angles[friction <= drag * np.tan(angles)])


def axial_ratio(share: float, angles: Floats, power: float) -> Floats:
    """Force along the tool (n,) over that on a level skin, at inclinations (n,) and with a sideways share of it.

    The depth along the normal is d cos t, and the force along the tool F_n (cos t + tan(phi) sin t), phi the friction
    angle t - arctan(share).
    """
    friction = np.tan(angles - math.atan(share))
    return np.asarray(np.cos(angles) ** power * (np.cos(angles) + friction * np.sin(angles)))


def _power(model: Any, depth: float) -> float:
    """Power of the depth that the force goes with at a depth [m]."""
    tip = getattr(model, "indenter", None)
    if not isinstance(tip, Indenter):
        return _HERTZ
    return float(depth * tip.contact_radius(depth) / tip.profile_area(depth))


def _stated(model: Any, declared: Mapping[str, Any], depth: float) -> tuple[float, float]:
    """The least and the largest inclination [rad] that is stated, within its uncertainty; 0 and 0 where none is."""
    skin = getattr(model, "skin", None)
    if skin is None:
        return 0.0, 0.0
    std = next((source.std for source in sources_of(model, declared) if source.name == "inclination"), 0.0)
    seen = [skin.inclination, *(skin.inclination_at(model.indenter, d) for d in (1e-6, depth))]
    return max(min(seen) - _WIDE * std, 0.0), max(seen) + _WIDE * std
