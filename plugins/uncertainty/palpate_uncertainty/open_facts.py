"""Facts of rig and specimen that a record cannot show and nobody has stated, each with the effect of another one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Condition, Diagnosed, Floats, Indenter, TrackEnd, TrackEvidence, contact_force
from palpate_engine import POISSON_RANGE, display_unit, remedy_of, words_that_state
from palpate_kit.budget.force_sensitivity import Along, along

from palpate_uncertainty.delay.commanded_motion import position_noise, share_of_command
from palpate_uncertainty.delay.one_frequency import one_frequency_text
from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous
from palpate_uncertainty.refit import depths_in_contact, zero_without_air
from palpate_uncertainty.undeclared_thickness import (
    BONDED_COEFFICIENTS,
    MIN_ELASTICITY_SHARE,
    half_space_from,
    stiffer_by,
)

# The alternatives, one for each fact, all of them choices: a change of this table is a change of schema.
HEIGHT = 22e-3  # [m] of a specimen
RADII = 10.0  # contact radii, in the height of a specimen under a tip below `SMALL`
DELAY = 10e-3  # [s] between force and motion, of an alternative
POISSON = 0.45  # of an alternative
MASS = 0.14  # [kg] behind the sensor of a robot, whose tips are not below `SMALL`
TARE = 0.02  # of the largest force
ZERO = 2.0  # standard uncertainties of a zero of the force that a fit found without air
TILT = math.radians(5.0)  # [rad] of a skin that a person takes for level
MOUNT = 200e3  # [N/m] of an arm or a stand that counts as rigid
BEAM = 0.05  # of its stiffness
SMALL = 0.5e-3  # [m] radius, below which a tip is of an instrument and not of a robot
_MIN_MILLIMETRES = 1e-4  # [m] from which on a length is shown in mm


@dataclass(frozen=True)
class _OpenTrack:
    """A track, its force along the end, and how conditions are worded."""

    evidence: TrackEvidence
    end: TrackEnd
    sensitivity: Along | None

    @property
    def names(self) -> list[str]:
        """The names of the parameters."""
        return [parameter.name for parameter in self.evidence.model.parameters]

    def table(self, shifts: Floats | None) -> dict[str, float]:
        """Return shifts (k,) by name; empty if they are unknown."""
        if shifts is None or not np.isfinite(shifts).all():
            return {}
        return dict(zip(self.names, shifts[: len(self.names)].tolist(), strict=True))

    def against(self, error: Floats) -> dict[str, float]:
        """Return the shifts of all values without an error (n,) [N] of the force."""
        answer = self.sensitivity.answer(error) if self.sensitivity is not None else None
        return self.table(None if answer is None else -answer)

    def along_with(self, unknown: str, sigmas: float) -> dict[str, float]:
        """Return the shifts of all values of a fit if an unknown were `sigmas` of its standard uncertainties higher."""
        report = self.evidence.report
        if report is None:
            return {}
        random = {name: report.unknowns[name].random or 0.0 for name in self.names if name in report.unknowns}
        return {name: sigmas * u * report.correlations.get((name, unknown), 0.0) for name, u in random.items()}

    def scaled(self, share: float) -> dict[str, float]:
        """Return the shifts, by a share of them, of all values that the force is proportional to."""
        model, values = self.evidence.model, self.evidence.values.tolist()
        return {p.name: share * v for p, v in zip(model.parameters, values, strict=True) if p.role}

    @property
    def is_small(self) -> bool:
        """True for the tip of an instrument, which is smaller than that of a robot."""
        radius = getattr(getattr(self.evidence.model, "indenter", None), "radius", None)
        return radius is not None and radius < SMALL


def open_facts(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the open facts of every track, each with the shifts of its values by an alternative."""
    findings = {}
    for evidence in tracks:
        end = evidence.ending
        if end is None:
            continue
        sensitivity = along(evidence.model, end.tail, end.last, evidence.values, end.held)
        track = _OpenTrack(evidence, end, sensitivity)
        findings[evidence.name] = Diagnosed(conditions=tuple(condition for fact in _FACTS for condition in fact(track)))
    return findings


def _thickness(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the half-space of a specimen of no stated thickness; the alternative is a bonded layer.

    A layer is stiffer than a half-space by a share that grows with contact radius over height: with one, all values
    that the force is proportional to would be smaller.
    """
    model = track.evidence.model
    needed = half_space_from(track.evidence)
    if getattr(model, "thickness", None) is not None or needed is None:
        return
    radius = needed * MIN_ELASTICITY_SHARE / BONDED_COEFFICIENTS[0]  # of the contact, as `half_space_from` has it
    height = RADII * radius if track.is_small else HEIGHT
    share = 1.0 / (1.0 + stiffer_by(radius, height)) - 1.0
    yield Condition(
        fact="thickness",
        text=f"specimen thicker than {_length(needed)}",
        remedy=words_that_state("thickness"),
        alternative=f"{_length(height)}",
        shifts=track.scaled(share),
        code="thickness-undeclared",
    )


def _base(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the glue of a layer of a stated height; one that slides on its base is softer (Dimitriadis 2002)."""
    layer = getattr(track.evidence.model, "thickness", None)
    if getattr(layer, "height", 0.0) <= 0 or getattr(layer, "bonded", True) is not None:
        return
    depth = depths_in_contact(track.evidence)
    shifts = track.scaled(stiffness_share(track.evidence, float(np.mean(depth)))) if len(depth) else {}
    yield Condition(
        fact="base",
        text="specimen glued to its base",
        remedy=words_that_state("base"),
        alternative="sliding",
        shifts=shifts,
    )


def stiffness_share(track: TrackEvidence, depth: float) -> float:
    """Return the share by which a value changes if the layer slides; 0 for a tip without a law for that."""
    model: Any = track.model
    thickness = model.thickness.model_copy(update={"law": "dimitriadis", "bonded": False})
    sliding_model = model.model_copy(update={"thickness": thickness})
    try:
        bonded = float(contact_force(model, depth, 0.0, track.values.tolist()))
        sliding = float(contact_force(sliding_model, depth, 0.0, track.values.tolist()))
    except ValueError:
        return 0.0
    return bonded / sliding - 1.0


def _delay(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the simultaneity of force and motion whose timing is not declared."""
    if track.end.settings.timing_uncertainty is not None or "timing" in track.end.included:
        return
    # If the force is late, the values are those without the shift by the delay.
    shifts = -delay_shifts(track.evidence.model, track.sensitivity, track.evidence.values)
    per_ms: list[str] = []
    for parameter, shift in zip(track.evidence.model.parameters, shifts.tolist(), strict=True):
        if is_viscous(parameter) and shift:
            per_ms.append(f"{parameter.name} {1e-3 * shift:+.2g} {display_unit(parameter.unit)[0]} per ms")
    text = f"force and motion simultaneous ({', '.join(per_ms)})" if per_ms else "force and motion simultaneous"
    effects = {name: DELAY * shift for name, shift in track.table(shifts).items() if name not in track.end.held}
    yield Condition(
        fact="delay",
        text=text,
        remedy=words_that_state("delay"),
        alternative=f"{1e3 * DELAY:g} ms",
        shifts=effects,
        code="timing-undeclared",
    )


def _tare(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the zero of a force: found by a fit without air, or assumed where no standstill determines it."""
    if (zero := zero_without_air(track.evidence)) is not None and track.end.settings.force_zero == "open":
        higher = ZERO * (zero.random or 0.0)  # [N], standard uncertainties by noise
        yield Condition(
            fact="tare",
            text=f"zero of the force at {zero.value:+.3g} N, found with the surface",
            remedy=words_that_state("tare"),
            alternative=f"{higher:.2g} N higher",
            shifts=track.along_with("bias", ZERO),
            code="tare-undeclared",
        )
        return
    tare, sensitivity = track.end.report.tare, track.sensitivity
    is_determined = "tare" in track.end.included or (tare is not None and tare.offset_std is not None)
    if sensitivity is None or is_determined:
        return
    offset = TARE * float(np.max(np.abs(sensitivity.force)))  # [N] of the zero, 2 % of the largest force
    yield Condition(
        fact="tare",
        text="no force without contact",
        remedy=words_that_state("tare"),
        alternative=f"{offset:.2g} N",
        shifts=track.against(np.full(len(sensitivity.force), offset)),  # of the values without that error of the force
        code="tare-undeclared",
    )


def _mass(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the mass behind the sensor of a robot."""
    if track.sensitivity is None or track.end.settings.tip_mass is not None or "mass" in track.end.included:
        return
    if not track.is_small:
        shifts = track.against(-MASS * track.sensitivity.acceleration)
        yield Condition(
            fact="mass",
            text="no mass behind the sensor",
            remedy=words_that_state("mass"),
            alternative=f"{1e3 * MASS:g} g",
            shifts=shifts,
        )


def _poisson(track: _OpenTrack) -> Iterator[Condition]:
    """Yield Poisson's ratio that a model has by default."""
    model, sensitivity = track.evidence.model, track.sensitivity
    value = getattr(model, "poisson", None)
    if sensitivity is None or not isinstance(value, float):
        return
    if "poisson" in model.model_fields_set or {"poisson", "model.poisson"} & track.end.uncertainties.keys():
        return
    change = POISSON - value  # from the default of the model to the alternative
    if change:
        shifts = track.against(change * sensitivity.by_number(("poisson",), value, change))
        text = f"Poisson's ratio {value - POISSON_RANGE:g} to {value:g}"
        yield Condition(
            fact="poisson", text=text, remedy=words_that_state("poisson"), alternative=f"{POISSON:g}", shifts=shifts
        )


def _level(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the level skin: a tip that slides on an inclination t has cos(t)^(p + 1) of the force, F ~ d^p."""
    model, depth = track.evidence.model, depths_in_contact(track.evidence)
    tip = getattr(model, "indenter", None)
    if "skin" not in type(model).model_fields or not isinstance(tip, Indenter) or not len(depth):
        return
    if getattr(model, "skin", None) is not None or track.end.settings.surface is not None:
        return
    mean = float(np.mean(depth))
    power = mean * float(tip.contact_radius(mean)) / float(tip.profile_area(mean))
    share = math.cos(TILT) ** -(1.0 + power) - 1.0
    yield Condition(
        fact="level", text="level skin", remedy=words_that_state("level"), alternative=f"{math.degrees(TILT):.0f} deg",
        shifts=track.scaled(share),
    )  # fmt: skip


def _mount(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the rigid mount of an arm or a stand of no stated stiffness."""
    sensitivity = track.sensitivity
    if sensitivity is None or sensitivity.given_way is None or track.end.settings.series_stiffness is not None:
        return
    shifts = track.against(-sensitivity.given_way / MOUNT)
    # A contact that is stiffer than a robot is rarer than a unit that is not the one in the head of a file.
    elasticity = dict(zip(track.names, track.evidence.values.tolist(), strict=True)).get("elasticity", math.inf)
    is_stiff = abs(shifts.get("elasticity", 0.0)) > abs(elasticity)
    text = "rigid mount, and force and height in the stated units" if is_stiff else "rigid mount"
    yield Condition(
        fact="mount", text=text, remedy=words_that_state("mount"), alternative=f"{1e-3 * MOUNT:g} N/mm", shifts=shifts
    )


def _beam(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the stiffness of a beam that is stated without an uncertainty."""
    sensitivity, stiffness = track.sensitivity, track.end.settings.beam
    if sensitivity is not None and stiffness is not None and track.end.settings.beam_uncertainty is None:
        shifts = track.against(BEAM * stiffness * sensitivity.by_beam(stiffness))
        text = f"a beam of {stiffness:.4g} N/m"
        yield Condition(
            fact="beam",
            text=text,
            remedy=words_that_state("beam"),
            alternative=f"{(1.0 + BEAM) * stiffness:.4g} N/m",
            shifts=shifts,
        )


def _position(track: _OpenTrack) -> Iterator[Condition]:
    """Yield a position whose noise is that of a command."""
    position = track.end.settings.position
    if position.measured or position.uncertainty is not None or track.evidence.estimator.motion == "velocity":
        return
    if share_of_command(*position_noise(track.evidence)):
        text = "the position is of the tip, and no command"
        yield Condition("position", text, words_that_state("position"), code="commanded-motion")


def _frequency(track: _OpenTrack) -> Iterator[Condition]:
    """Yield the one frequency that a viscosity is of."""
    if text := one_frequency_text(track.evidence):
        yield Condition("frequency", text, remedy_of("frequency"), code="one-frequency")


_FACTS: tuple[Callable[[_OpenTrack], Iterator[Condition]], ...] = (
    _thickness, _base, _delay, _tare, _mass, _poisson, _level, _mount, _beam, _position, _frequency,
)  # fmt: skip


def _length(metres: float) -> str:
    """Return a length in mm, or in um where that is less than a tenth of one."""
    factor, unit = (1e3, "mm") if metres >= _MIN_MILLIMETRES else (1e6, "um")
    return f"{float(f'{factor * metres:.2g}'):g} {unit}"
