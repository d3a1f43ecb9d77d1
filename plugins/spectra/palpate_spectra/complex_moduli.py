"""Complex moduli from phasors: inertia and compliance first, then the contact, then what is not exactly known."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import ContactModel, Floats
from palpate_kit.budget.force_sensitivity import with_change
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_spectra.frequency_sweep import pieces
from palpate_spectra.recorded_oscillation import RecordedOscillation
from palpate_spectra.sine_stretch import sine_stretch
from palpate_spectra.spectral_lines import LineFit, fit_lines

_STEP = 1e-3  # of a number, for derivatives by differences
_FORCE, _DEPTH, _AREA, _OTHER = range(4)  # channels; the last is the area if the skin were higher by its uncertainty


@dataclass(frozen=True)
class ModulusLine:
    """The material's answer at one frequency of one recording [SI]."""

    run: str
    frequency: float  # [Hz]
    amplitude: float  # [m] of the depth
    depth: float  # [m] mean
    area: float  # [m^2] amplitude of the area A(d) in the reduced plane
    poisson: float
    shear: complex  # G* [Pa]
    noise: float  # [Pa] standard deviation of G' and of G'' by the noise; they are not correlated
    freedom: float  # degrees of freedom of that
    shifts: Mapping[str, complex]  # of G* [Pa] by one standard uncertainty of each source
    by_delay: complex  # derivative of G* by the delay of the force [Pa/s]
    delayed: Callable[[float], complex]  # G* [Pa] if the force is late by so much [s]
    apart: Mapping[str, str] = field(default_factory=dict)  # by source: lines of one word share it; none: all do

    @property
    def young(self) -> complex:
        """E* = 2 (1 + nu) G* [Pa]."""
        return 2.0 * (1.0 + self.poisson) * self.shear

    @property
    def loss_tangent(self) -> float:
        """tan(delta) = G''/G'."""
        return self.shear.imag / self.shear.real

    @property
    def covariance(self) -> Floats:
        """Covariance (2, 2) [Pa^2] of G' and G''."""
        parts = [np.array([shift.real, shift.imag]) for shift in self.shifts.values()]
        return np.asarray(self.noise**2 * np.eye(2) + sum((np.outer(part, part) for part in parts), np.zeros((2, 2))))

    def std(self, *, of: str) -> float:
        """Standard uncertainty of "storage" or "loss" [Pa], or of "tan"."""
        g = self.shear
        gradient = {
            "storage": np.array([1.0, 0.0]), "loss": np.array([0.0, 1.0]),
            "tan": np.array([-g.imag, g.real]) / g.real**2,
        }[of]  # fmt: skip
        return math.sqrt(float(gradient @ self.covariance @ gradient))


@dataclass(frozen=True)
class RecordingModuli:
    """Results of one recording: its lines, and the force at the sums and differences of these."""

    recorded: RecordedOscillation
    lines: tuple[ModulusLine, ...]
    mixed: LineFit | None  # force, depth and area at what a nonlinear contact makes; None of a sweep
    sweep: bool


def poisson_of(model: Any) -> float:
    """Poisson's ratio of a model that has one."""
    return float(model.poisson)


def area(model: ContactModel, depth: Floats) -> Floats:
    """Area A(d) c(d) [m^2] of the tip in the reduced plane, with the layer's factor and the skin; 0 out of contact."""
    held: Any = model
    inside = np.maximum(depth, 1e-9)
    if (skin := getattr(held, "skin", None)) is not None:
        return np.where(depth > 0, skin.contact(held.indenter, held.thickness, held.poisson, inside)[0], 0.0)
    found = np.asarray(held.indenter.profile_area(inside))
    thickness = getattr(held, "thickness", None)
    if thickness is not None and not isinstance(thickness, str):  # "half-space"
        found = found * np.asarray(thickness.factor(held.indenter, inside)[0])
    return np.where(depth > 0, found, 0.0)


def answer(recorded: RecordedOscillation, frequencies: Sequence[float] | None = None) -> RecordingModuli:
    """Return G* at the frequencies [Hz] of a motion, found in it unless they are given.

    An approach and a smooth start before the sines are left out. Raises ConfigurationError where sines of given
    frequencies do not explain the motion.

    F = 4/(1 - nu) int G(t - s) dA(d(s)) is linear in the area A (Lee and Radok 1960; Popov and Hess 2015), so that
    G*(w) = (1 - nu)/4 F^(w)/A^(w), with the phasors of the contact force and of the area along the measured depth. For
    one sine A^ = D a_eff, a_eff = (1/pi) int_0^2pi a(d0 + D cos th) sin^2 th dth; for several at once it holds what
    they make of each other. Before that the compliance C_s of arm and sensor comes off the depth, d = d_arm - C_s u,
    and then the inertia off the force, F = u - m d''.
    """
    stretch = sine_stretch(recorded.time, recorded.height, frequencies)
    if stretch is not None:
        recorded = recorded.cut(stretch[0])
    depth = recorded.surface - recorded.height - recorded.compliance * recorded.force
    deeper = area(recorded.model, depth + recorded.surface_std)
    channels = np.column_stack([recorded.force, depth, area(recorded.model, depth), deeper])
    if stretch is not None:
        lines = stretch[1]
        found, other = fit_lines(recorded.time, channels, lines)
        pairs = zip(_split(found), np.zeros(len(lines)), strict=True)
        return RecordingModuli(recorded, tuple(_line(recorded, one, bend) for one, bend in pairs), other, False)
    fits, bends = pieces(recorded.time, channels, _DEPTH)
    found_lines = [_line(recorded, one, bend) for one, bend in zip(fits, bends.tolist(), strict=True)]
    return RecordingModuli(recorded, tuple(sorted(found_lines, key=lambda line: line.frequency)), None, True)


def _split(found: LineFit) -> list[LineFit]:
    rows = [slice(i, i + 1) for i in range(len(found.frequencies))]
    return [
        LineFit(found.frequencies[r], found.phasors[r], found.covariances[r], found.freedom[r], found.level)
        for r in rows
    ]


def _line(recorded: RecordedOscillation, fit: LineFit, bend: float) -> ModulusLine:
    """One line with its uncertainty, every source apart."""
    u, d, a, other = (complex(value) for value in fit.phasors[0])
    frequency = float(fit.frequencies[0])
    omega = 2 * math.pi * frequency
    turned = omega**2 - 2j * math.pi * bend  # -d''/d of a sine whose frequency changes
    poisson = poisson_of(recorded.model)
    arm, effective = d + recorded.compliance * u, a / d

    def shear(
        delay: float = 0.0, mass: float = recorded.tip_mass, compliance: float = recorded.compliance,
        nu: float = poisson, radius: complex = effective,
    ) -> complex:  # fmt: skip
        force = u * np.exp(1j * omega * delay)
        tip = arm - compliance * force
        return complex((1.0 - nu) / 4.0 * (force / tip + mass * turned) / radius)

    value = shear()
    per_area = 4.0 * value / (1.0 - poisson)
    weights = (1.0 - poisson) / 4.0 / a * np.array([1.0, recorded.tip_mass * turned, -per_area, 0.0])
    noise = math.sqrt(max(float(np.real(weights @ fit.covariances[0] @ weights.conj())), 0.0) / 2.0)
    shifts = {
        "mass": shear(mass=recorded.tip_mass + recorded.tip_mass_std) - value,
        "compliance": shear(compliance=recorded.compliance + recorded.compliance_std) - value,
        "surface": shear(radius=other / d) - value,
    }
    by_delay = (shear(delay=1e-6) - shear(delay=-1e-6)) / 2e-6
    shifts["timing"] = by_delay * (recorded.timing or 0.0)
    shifts |= _of_model(recorded, fit, value, shear)
    return ModulusLine(
        recorded.name, frequency, abs(d), float(fit.level[_DEPTH]), abs(a), poisson, value, noise,
        float(fit.freedom[0]),
        {name: shift for name, shift in shifts.items() if shift}, by_delay, lambda delay: shear(delay=delay),
        _apart(recorded),
    )  # fmt: skip


def _apart(recorded: RecordedOscillation) -> dict[str, str]:
    """Return what errors are apart by: each recording has its own of the skin, and each tip one of its radius."""
    sources = sources_of(recorded.model, recorded.uncertainties)
    of_tip = {source.name: repr(source.value) for source in sources if source.path[:1] == ("indenter",)}
    return {"surface": recorded.name, **of_tip}


def _of_model(
    recorded: RecordedOscillation, fit: LineFit, value: complex, shear: Callable[..., complex]
) -> dict[str, complex]:
    """Shifts of G* [Pa] by what is declared of tip, layer and readings, or has a default."""
    found: dict[str, complex] = {}
    for source in sources_of(recorded.model, recorded.uncertainties):
        if not source.path:
            found[source.name] = value * source.std * (1.0 if source.name == "force_scale" else -1.0)
        elif source.path == ("poisson",):
            found[source.name] = shear(nu=source.value - source.std) - value
        else:
            step = _STEP * (abs(source.value) or 1.0)
            found[source.name] = value * _relative(recorded, fit, source.path, step) * source.std
    return found


def _relative(recorded: RecordedOscillation, fit: LineFit, path: tuple[str, ...], step: float) -> float:
    """Relative change of G* per unit of a number of the model.

    By the effective radius of one sine at the line's depth and amplitude, by 64 points of its cycle.
    """
    angle = 2 * np.pi * (np.arange(64) + 0.5) / 64
    depth = float(fit.level[_DEPTH]) + abs(complex(fit.phasors[0, _DEPTH])) * np.cos(angle)
    before = float(area(recorded.model, depth) @ np.cos(angle))
    after = float(area(with_change(recorded.model, path, step), depth) @ np.cos(angle))
    return (before / after - 1.0) / step if after else 0.0
