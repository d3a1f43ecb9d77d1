"""The test that the force across the tool is that of a skin as inclined as it is stated to be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Bias, Diagnosed, Flag, Floats, Indenter, TrackEnd, TrackEvidence
from palpate_engine import SidewaysShare
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_uncertainty.refit import depths_in_contact

# They apply to a sphere whose sensor measures the force across it as well.
_HERTZ_POWER = 1.5  # power of the depth that the force under a sphere is proportional to, by the law of Hertz
_MAX_TILT = math.radians(45.0)  # of a skin under the tip
_TILT_STEP = math.radians(0.05)  # of the angles that are looked through
_SHALLOW_DEPTH = 1e-6  # [m], a choice: the inclination where a tip has just touched
_MIN_DEVIATIONS = 5.0  # standard deviations of a share that is not by chance
_MIN_SHARE = 0.02  # share; the axes of a force sensor hear one another by so much
_COVERAGE_FACTOR = 2.0  # standard uncertainties of an inclination


@dataclass(frozen=True)
class AcrossForce:
    """The force across the tool against what is stated of the skin."""

    share: SidewaysShare
    model: Any
    depth: float  # [m] mean
    stated: tuple[float, float]  # [rad] the least and the largest inclination, within its uncertainty
    std: float  # [rad] of it

    @classmethod
    def of(cls, track: TrackEvidence, end: TrackEnd) -> AcrossForce | None:
        """Return the force across the tool; None without one, and on a sweep, whose friction explains any."""
        share, depth = end.report.sideways, depths_in_contact(track)
        if share is None or end.is_sweep or not len(depth) or not np.isfinite(track.values).all():
            return None
        sources = sources_of(track.model, end.uncertainties)
        std = next((source.std for source in sources if source.name == "inclination"), 0.0)
        low, high = _stated_range(track.model, std, float(np.mean(depth)))
        if end.report.turned is not None:  # a tip that does not go along a stated normal rubs
            low, high = min(low, high), max(high, math.atan(end.report.turned.slope))
        return cls(share=share, model=track.model, depth=float(np.mean(depth)), stated=(low, high), std=std)

    @property
    def drag(self) -> float:
        """The stiffness of a contact along the skin over that along the normal (Mindlin 1949)."""
        poisson = float(getattr(self.model, "poisson", 0.5))  # a model without one is taken as incompressible
        return 2.0 * (1.0 - poisson) / (2.0 - poisson)

    @property
    def is_beyond(self) -> bool:
        """True if the force is more than that of a tip that slides at the stated inclination."""
        return self.share.size - _MIN_DEVIATIONS * self.share.std > max(math.tan(self.stated[1]), _MIN_SHARE)

    @property
    def is_below(self) -> bool:
        """True if the force is less than that of a tip that sticks."""
        return self.share.size + max(_MIN_DEVIATIONS * self.share.std, _MIN_SHARE) < _sideways(
            self.stated[0], self.drag
        )

    @property
    def tells_friction(self) -> bool:
        """True if the skin is stated to be inclined, and the force shows how far the tip slides or sticks."""
        inclined = bool(getattr(getattr(self.model, "skin", None), "inclination", 0.0))
        return inclined and not (self.is_beyond or self.is_below)

    def axial(self, angle: float) -> float:
        """Return the force along the tool over that of the model, whose tip is between sliding and sticking.

        At an inclination t that is (cos t + tan(phi) sin t)/(cos t + s m sin t tan t), tan(phi) between 0 and m tan t.
        """
        friction = math.tan(min(max(angle - math.atan(self.share.size), 0.0), math.atan(self.drag * math.tan(angle))))
        assumed = float(self.model.skin.stick) * self.drag * math.tan(angle)
        return (1.0 + friction * math.tan(angle)) / (1.0 + assumed * math.tan(angle))


def inclined_skin(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return what the force's other axes show of inclination and friction, of each track whose record has them.

    A press along the tool on a skin that is inclined by t against it has tan(t - phi) of the force sideways, phi the
    friction angle, tan(phi) at most m tan t where the tip sticks, m = 2 (1 - nu)/(2 - nu). So a share r stands for an
    inclination between arctan(r), of a tip that slides, and t with r = (1 - m) tan t/(1 + m tan^2 t). Friction never
    makes the inclination less. A flag names a share beyond the stated inclination, or below it, with its effect on the
    values. Otherwise r and t give the friction: all three axes give the force along the normal, F_n, and so the error
    of the values by the model's one axis. It is a known bias, with the corrected values next to it.
    """
    findings = {}
    for track in tracks:
        if track.ending is not None and (across := AcrossForce.of(track, track.ending)) is not None:
            findings[track.name] = _finding(track, across)
    return findings


def _finding(track: TrackEvidence, across: AcrossForce) -> Diagnosed:
    """Return the flag of a share that is not that of the stated inclination, else the bias by friction."""
    angles = possible_inclinations(across.share.size, across.drag)
    table = {"share": across.share.size, "std": across.share.std, "inclinations": angles[[0, -1]].tolist()}
    if across.is_beyond or across.is_below:
        return Diagnosed((_flag(track, across, angles),), table=table)
    return Diagnosed(table=table, biases=_biases(track, across) if across.tells_friction else {})


def _flag(track: TrackEvidence, across: AcrossForce, angles: Floats) -> Flag:
    """Return the flag of an inclination that is not the stated one, with its largest effect on the values.

    `angles` (m,) [rad] are the inclinations that the force across the tool allows, from that of a tip that slides to
    that of one that friction holds.
    """
    low, high = across.stated
    power, skin = _power(across), getattr(across.model, "skin", None)
    # The force along the tool at the stated inclination t: cos(t)^(p + 1) (1 + s m tan(t)^2) of that on a level skin.
    cosine = math.cos(high if across.is_beyond else low)
    friction = 0.0 if skin is None else skin.stick * across.drag
    stated_ratio = cosine ** (power + 1.0) * (1.0 + friction * (1.0 / cosine**2 - 1.0))
    largest_error = float(np.max(np.abs(stated_ratio / axial_ratio(across.share.size, angles, power) - 1.0)))
    effects = {name: largest_error * abs(value) for name, value in _scaling(track)}
    first, last = np.degrees(angles[[0, -1]]).tolist()
    text = (
        f"{100 * across.share.size:.2g} % of the force is across the tool: the skin is inclined by {first:.2g} deg "
        f"where the tip slides, by up to {last:.2g} deg where friction holds it, and not by {_words(low, high)}"
    )
    return Flag("inclined-skin", text, effects=effects, causes=("inclination", "stick"))


def _biases(track: TrackEvidence, across: AcrossForce) -> dict[str, Bias]:
    """Return the errors of the values by a model that has one axis only."""
    angle = across.model.skin.inclination_at(across.model.indenter, across.depth)
    ratio = across.axial(angle)
    by_angle = across.axial(angle + across.std) - ratio
    by_share = across.share.std * math.tan(angle)
    std = math.hypot(by_angle, by_share) / ratio
    return {name: Bias(value * (1.0 - 1.0 / ratio), abs(value) * std, shared=True) for name, value in _scaling(track)}


def _scaling(track: TrackEvidence) -> Iterator[tuple[str, float]]:
    """Yield name and value of the parameters that the force is proportional to."""
    for parameter, value in zip(track.model.parameters, track.values.tolist(), strict=True):
        if parameter.role is not None:
            yield parameter.name, value


def _words(low: float, high: float) -> str:
    """Return the stated range [rad] of the inclination in words."""
    if high == 0.0:
        return "0 as is assumed"
    return f"{math.degrees(low):.2g} to {math.degrees(high):.2g} deg as is stated"


def _sideways(angle: float, drag: float) -> float:
    """Return the share of the force that is sideways where the tip sticks."""
    return (1.0 - drag) * math.tan(angle) / (1.0 + drag * math.tan(angle) ** 2)


def possible_inclinations(share: float, drag: float) -> Floats:
    """Return the inclinations (n,) [rad], up to 45 degrees, that give a sideways share of the force."""
    angles = math.atan(share) + np.arange(0.0, _MAX_TILT, _TILT_STEP)
    angles = angles[angles < _MAX_TILT] if share < math.tan(_MAX_TILT) else angles[:1]
    friction = np.tan(angles - math.atan(share))
    return np.asarray(angles[friction <= drag * np.tan(angles)])


def axial_ratio(share: float, angles: Floats, power: float) -> Floats:
    """Return the force (n,) along the tool over that on a level skin, at inclinations (n,), with a sideways share.

    The depth along the normal is d cos t, and the force along the tool F_n (cos t + tan(phi) sin t), phi the friction
    angle t - arctan(share).
    """
    friction = np.tan(angles - math.atan(share))
    return np.asarray(np.cos(angles) ** power * (np.cos(angles) + friction * np.sin(angles)))


def _power(across: AcrossForce) -> float:
    """Return the power of the depth that the force is proportional to: p = d a/A by contact radius and profile area."""
    tip = getattr(across.model, "indenter", None)
    if not isinstance(tip, Indenter):
        return _HERTZ_POWER
    return float(across.depth * tip.contact_radius(across.depth) / tip.profile_area(across.depth))


def _stated_range(model: Any, std: float, depth: float) -> tuple[float, float]:
    """Return the least and the largest stated inclination [rad], within its uncertainty; zeros without one."""
    skin = getattr(model, "skin", None)
    if skin is None:
        return 0.0, 0.0
    at_depths = (skin.inclination_at(model.indenter, d) for d in (_SHALLOW_DEPTH, depth))
    angles = [skin.inclination, *at_depths]
    return max(min(angles) - _COVERAGE_FACTOR * std, 0.0), max(angles) + _COVERAGE_FACTOR * std
