"""Complex moduli from phasors: compliance and inertia are taken off, then the contact; each with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from palpate import Floats
from palpate_kit.budget.force_sensitivity import with_change
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_spectra.frequency_sweep import fit_pieces
from palpate_spectra.recorded_oscillation import RecordedOscillation
from palpate_spectra.reduced_area import poisson_of, reduced_area
from palpate_spectra.sine_stretch import sine_stretch
from palpate_spectra.spectral_lines import LineFit, fit_lines

# Choices.
RELATIVE_STEP = 1e-3  # of a model's number, for derivatives by differences
_DELAY_STEP = 1e-6  # [s] for derivatives by the delay: small against any period, large against rounding
_CYCLE_POINTS = 64  # of a sine, over which its effective radius is averaged

# Columns of the channels that are fitted; the last is the area if the skin were higher by its uncertainty.
_FORCE, _DEPTH, _AREA, _HIGHER_AREA = range(4)


@dataclass(frozen=True)
class ModulusLine:
    """The material's modulus at one frequency of one recording [SI]."""

    run: str
    frequency: float  # [Hz]
    amplitude: float  # [m] of the depth
    depth: float  # [m] mean
    area: float  # [m^2] amplitude of the area A(d) in the reduced plane
    poisson: float
    shear: complex  # G* [Pa]
    noise: float  # [Pa] standard deviation of G' and of G'' by the noise; they are not correlated
    freedom: float  # degrees of freedom of `noise`
    shifts: Mapping[str, complex]  # of G* [Pa] by one standard uncertainty of each source
    delay_derivative: complex  # of G* by the delay of the force [Pa/s]
    shear_of_delay: Callable[[float], complex]  # G* [Pa] if the force is late by so much [s]
    # By source: lines of one group have the same error, those of two groups independent ones. Without a group: all.
    error_groups: Mapping[str, str] = field(default_factory=dict)

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
        """Covariance (2, 2) [Pa^2] of G' and G'': noise, and the shift by each source with itself."""
        shifts = [np.array([shift.real, shift.imag]) for shift in self.shifts.values()]
        systematic = sum((np.outer(shift, shift) for shift in shifts), np.zeros((2, 2)))
        return np.asarray(self.noise**2 * np.eye(2) + systematic)

    def std_of(self, quantity: str) -> float:
        """Return the standard uncertainty of "storage" or "loss" [Pa], or of "tan", by the gradient over G', G''."""
        g = self.shear
        gradient = {
            "storage": np.array([1.0, 0.0]), "loss": np.array([0.0, 1.0]),
            "tan": np.array([-g.imag, g.real]) / g.real**2,
        }[quantity]  # fmt: skip
        return math.sqrt(float(gradient @ self.covariance @ gradient))


@dataclass(frozen=True)
class RecordingModuli:
    """The moduli of one recording: its lines, and the force at sums and differences of their frequencies."""

    recording: RecordedOscillation
    lines: tuple[ModulusLine, ...]
    intermodulation: LineFit | None  # force, depth and area where a nonlinear contact has a force; None of a sweep
    sweep: bool


@dataclass(frozen=True)
class _LineResponse:
    """Phasors of one line and the numbers of the rig [SI] from which its modulus follows."""

    omega: float  # [rad/s]
    force: complex  # U [N] at the sensor
    arm_depth: complex  # D_arm [m]
    effective_radius: complex  # A^/D [m]
    curvature: complex  # -d''/d [1/s^2] of the depth: w^2 of a sine
    tip_mass: float
    compliance: float
    poisson: float
    delay: float = 0.0  # [s] of the force

    @property
    def shear(self) -> complex:
        """G* = (1 - nu)/4 (U/D + m w^2)/a [Pa], D = D_arm - C U, of the force U without its delay."""
        force = self.force * np.exp(1j * self.omega * self.delay)
        depth = self.arm_depth - self.compliance * force
        stiffness = force / depth + self.tip_mass * self.curvature
        return complex((1.0 - self.poisson) / 4.0 * stiffness / self.effective_radius)


def measure_moduli(recording: RecordedOscillation, frequencies: Sequence[float] | None = None) -> RecordingModuli:
    """Return G* at the frequencies [Hz] of a motion, which are found in it unless they are stated.

    An approach and a smooth start before the sines are left out. Raises ConfigurationError where sines of stated
    frequencies do not explain the motion.

    F = 4/(1 - nu) int G(t - s) dA(d(s)) is linear in the area A (Lee and Radok 1960; Popov and Hess 2015), so that
    G*(w) = (1 - nu)/4 F^(w)/A^(w), with the phasors of the contact force and of the area along the measured depth. For
    one sine A^ = D a, a = (1/pi) int_0^2pi a(d0 + D cos th) sin^2 th dth the effective radius; for several at once A^
    holds what they make of each other. Before that the compliance C of arm and sensor is taken off the depth,
    d = d_arm - C u, and then the inertia off the force u of the sensor, F = u - m d''.
    """
    stretch = sine_stretch(recording.time, recording.height, frequencies)
    if stretch is not None:
        recording = recording.cut(stretch[0])
    depth = recording.surface - recording.height - recording.compliance * recording.force
    area = reduced_area(recording.model, depth)
    higher_area = reduced_area(recording.model, depth + recording.surface_std)
    channels = np.column_stack([recording.force, depth, area, higher_area])
    if stretch is not None:
        fit, intermodulation = fit_lines(recording.time, channels, stretch[1])
        sines = [_modulus_line(recording, fit.line(i), chirp_rate=0.0) for i in range(len(fit.frequencies))]
        return RecordingModuli(recording, tuple(sines), intermodulation, sweep=False)
    # The frequency changes: each piece of the sweep is a line.
    fits, chirp_rates = fit_pieces(recording.time, channels, _DEPTH)
    pieces = [_modulus_line(recording, fit, rate) for fit, rate in zip(fits, chirp_rates.tolist(), strict=True)]
    pieces.sort(key=lambda line: line.frequency)
    return RecordingModuli(recording, tuple(pieces), intermodulation=None, sweep=True)


def _modulus_line(recording: RecordedOscillation, fit: LineFit, chirp_rate: float) -> ModulusLine:
    """Return the modulus of a fit of one line, whose frequency changes by a rate [Hz/s], with its uncertainties."""
    force, depth, area, _ = (complex(phasor) for phasor in fit.phasors[0])
    frequency = float(fit.frequencies[0])
    omega = 2 * math.pi * frequency
    response = _LineResponse(
        omega=omega,
        force=force,
        arm_depth=depth + recording.compliance * force,
        effective_radius=area / depth,
        # Twice differentiated, exp(i phase) has -(phase')^2 + i phase'' as its factor.
        curvature=omega**2 - 2j * math.pi * chirp_rate,
        tip_mass=recording.tip_mass,
        compliance=recording.compliance,
        poisson=poisson_of(recording.model),
    )
    late, early = replace(response, delay=_DELAY_STEP), replace(response, delay=-_DELAY_STEP)
    delay_derivative = (late.shear - early.shear) / (2 * _DELAY_STEP)
    shifts = _rig_shifts(recording, fit, response)
    shifts["timing"] = delay_derivative * (recording.timing or 0.0)
    shifts |= _model_shifts(recording, fit, response)
    return ModulusLine(
        run=recording.name,
        frequency=frequency,
        amplitude=abs(depth),
        depth=float(fit.channel_means[_DEPTH]),
        area=abs(area),
        poisson=response.poisson,
        shear=response.shear,
        noise=_noise_std(fit, response),
        freedom=float(fit.freedom[0]),
        shifts={source: shift for source, shift in shifts.items() if shift},
        delay_derivative=delay_derivative,
        shear_of_delay=lambda delay: replace(response, delay=delay).shear,
        error_groups=_error_groups(recording),
    )


def _noise_std(fit: LineFit, response: _LineResponse) -> float:
    """Return the standard deviation [Pa] of G' and of G'' by the noise of the phasors of force, depth and area.

    To first order dG* = (1 - nu)/(4 A^) (dU + m w^2 dD) - G* dA^/A^; each of its quadratures has half the variance.
    """
    area = complex(fit.phasors[0, _AREA])
    force_per_area = 4.0 * response.shear / (1.0 - response.poisson)
    gradient = np.array([1.0, response.tip_mass * response.curvature, -force_per_area, 0.0])
    weights = (1.0 - response.poisson) / 4.0 / area * gradient
    variance = max(float(np.real(weights @ fit.covariances[0] @ weights.conj())), 0.0)
    return math.sqrt(variance / 2.0)


def _rig_shifts(recording: RecordedOscillation, fit: LineFit, response: _LineResponse) -> dict[str, complex]:
    """Return the shifts of G* [Pa] by one standard uncertainty of mass, compliance and height of the skin."""
    heavier = replace(response, tip_mass=recording.tip_mass + recording.tip_mass_std)
    softer = replace(response, compliance=recording.compliance + recording.compliance_std)
    higher_radius = complex(fit.phasors[0, _HIGHER_AREA]) / complex(fit.phasors[0, _DEPTH])
    deeper = replace(response, effective_radius=higher_radius)
    changed_responses = {"mass": heavier, "compliance": softer, "surface": deeper}
    return {source: changed.shear - response.shear for source, changed in changed_responses.items()}


def _model_shifts(recording: RecordedOscillation, fit: LineFit, response: _LineResponse) -> dict[str, complex]:
    """Return the shifts of G* [Pa] by one standard uncertainty of each number of tip, layer and readings.

    The uncertainties are declared, or have a default (`sources_of`).
    """
    shear = response.shear
    shifts: dict[str, complex] = {}
    for source in sources_of(recording.model, recording.uncertainties):
        if not source.path:
            # A factor of the readings: G* goes with the force, and against the position.
            shifts[source.name] = shear * source.std * (1.0 if source.name == "force_scale" else -1.0)
        elif source.path == ("poisson",):
            shifts[source.name] = replace(response, poisson=source.value - source.std).shear - shear
        else:
            step = RELATIVE_STEP * (abs(source.value) or 1.0)
            shifts[source.name] = shear * _relative_derivative(recording, fit, source.path, step) * source.std
    return shifts


def _error_groups(recording: RecordedOscillation) -> dict[str, str]:
    """Return the group of each error that not all recordings share.

    Each recording has an error of its own of the skin's height, and each tip one of its size.
    """
    sources = sources_of(recording.model, recording.uncertainties)
    tips = {source.name: repr(source.value) for source in sources if source.path[:1] == ("indenter",)}
    return {"surface": recording.name, **tips}


def _relative_derivative(recording: RecordedOscillation, fit: LineFit, path: tuple[str, ...], step: float) -> float:
    """Return the relative change of G* per unit of the model's number at a path of keys, by a step of the number.

    G* goes with 1/a, a the effective radius of one sine at the line's depth and amplitude: the mean of A(d) cos(th)
    over the cycle, up to a factor.
    """
    angle = 2 * np.pi * (np.arange(_CYCLE_POINTS) + 0.5) / _CYCLE_POINTS
    amplitude = abs(complex(fit.phasors[0, _DEPTH]))
    depth = float(fit.channel_means[_DEPTH]) + amplitude * np.cos(angle)
    radius = float(reduced_area(recording.model, depth) @ np.cos(angle))
    changed_model = with_change(recording.model, path, step)
    changed_radius = float(reduced_area(changed_model, depth) @ np.cos(angle))
    return (radius / changed_radius - 1.0) / step if changed_radius else 0.0
