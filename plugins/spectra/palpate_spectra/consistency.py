"""Tests of a spectrum that hold for any linear material: Kramers and Kronig's relations, and the tip's harmonics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

from palpate_spectra.complex_moduli import ModulusLine, RecordingModuli
from palpate_spectra.joint_covariance import WeightedFit, fit_jointly, stack_moduli
from palpate_spectra.spectral_lines import Phasors

# Choices.
_TIMES_PER_DECADE = 6  # relaxation times of the test of Kramers and Kronig
_RANGE_FACTOR = 30.0  # by which the relaxation times go beyond the range of the frequencies, on either side
_REJECTION_LEVEL = 1e-3  # of a test's p
_MIN_EXCESS_SHARE = 0.01  # of the largest line of the force: a smaller harmonic does not matter
_MIN_VARIANCE = 1e-300  # [N^2] keeps a division by a variance finite


@dataclass(frozen=True)
class Consistency:
    """Distance of moduli from those of the nearest passive linear material."""

    chi2: float
    freedom: int  # degrees of freedom of chi2; 0: so few frequencies that anything fits
    p: float

    @property
    def failed(self) -> bool:
        """True if no passive linear material has these moduli."""
        return self.freedom > 0 and self.p < _REJECTION_LEVEL


@dataclass(frozen=True)
class Harmonic:
    """The force at a sum or difference of the lines, against that of the tip's own law."""

    frequency: float  # [Hz]
    found: float  # [N] amplitude of the force
    expected: float  # [N] amplitude by the tip's law
    excess: float  # [N] amplitude of the difference of the two phasors
    std: float  # [N] of the quadratures of the difference
    p: float  # probability of so large an excess by noise


def kramers_kronig(lines: Sequence[ModulusLine]) -> Consistency:
    """Return the test of whether G' and G'' belong to one causal, passive, linear material.

    Every such material is a spring, a dashpot and Maxwell arms of positive strengths in parallel, so that least squares
    with non-negative strengths over a dense grid of relaxation times leaves nothing but the noise (Boukamp 1995, with
    the sign of mechanics; Lawson and Hanson 1974). A wrong mass, compliance or timing is beyond what it can follow.
    """
    from scipy.optimize import nnls
    from scipy.stats import chi2

    basis = _material_basis(2 * np.pi * np.array([line.frequency for line in lines]))
    stacked_basis, moduli = np.vstack([basis.real, basis.imag]), stack_moduli(lines)
    strengths = np.zeros(basis.shape[1])

    def fit_under(cholesky_factor: Floats, _iteration: int) -> WeightedFit:
        """Return the fit under a covariance, and keep its strengths."""
        whitened = np.linalg.solve(cholesky_factor, stacked_basis)
        norms = np.linalg.norm(whitened, axis=0)
        strengths[:] = nnls(whitened / norms, np.linalg.solve(cholesky_factor, moduli))[0] / norms
        derivatives: Any = stacked_basis[:, strengths > 0]
        prediction: Any = basis @ strengths
        return WeightedFit(moduli - stacked_basis @ strengths, derivatives, prediction)

    joint = fit_jointly(lines, fit_under)
    freedom = max(2 * len(lines) - _parameter_count(strengths) - joint.scatter.parameter_count, 0)
    return Consistency(joint.chi2, freedom, float(chi2.sf(joint.chi2, freedom)) if freedom else math.nan)


def _material_basis(omega: Floats) -> Phasors:
    """Return G* at (n,) [rad/s] of a spring, a dashpot and Maxwell arms of strength 1 (n, 2 + k).

    1, i w and i w tau/(1 + i w tau), with relaxation times tau from 1/30 of the shortest to 30 of the longest period.
    """
    decades = math.log10(_RANGE_FACTOR**2 * omega.max() / omega.min())
    shortest, longest = 1 / (_RANGE_FACTOR * omega.max()), _RANGE_FACTOR / omega.min()
    times = np.geomspace(shortest, longest, math.ceil(_TIMES_PER_DECADE * decades))
    omega_tau = 1j * np.outer(omega, times)
    return np.column_stack([np.ones(len(omega)), 1j * omega, omega_tau / (1 + omega_tau)]).astype(np.complex128)


def _parameter_count(strengths: Floats) -> int:
    """Return the number of parameters behind strengths of a spring, a dashpot and Maxwell arms (2 + k,).

    Neighbouring arms of positive strength stand for one arm of a time between theirs, which has two parameters.
    """
    spring_and_dashpot, arms = strengths[:2] > 0, strengths[2:] > 0
    arm_begins = np.flatnonzero(np.diff(np.concatenate([[0], arms.astype(int)])) == 1)
    return int(spring_and_dashpot.sum()) + 2 * len(arm_begins)


def harmonics(moduli: RecordingModuli) -> list[Harmonic]:
    """Return the force at the sums and differences of the lines; empty for a motion whose frequency changes."""
    intermodulation = moduli.intermodulation
    if intermodulation is None:
        return []
    frequencies, freedom = intermodulation.frequencies.tolist(), intermodulation.freedom.tolist()
    return [
        _harmonic(moduli, frequency, phasors, covariance, degrees)
        for frequency, phasors, covariance, degrees in zip(
            frequencies, intermodulation.phasors, intermodulation.covariances, freedom, strict=True
        )
    ]


def _harmonic(
    moduli: RecordingModuli, frequency: float, phasors: Phasors, covariance: Phasors, freedom: float
) -> Harmonic:
    """Return the harmonic at a frequency [Hz], of phasors (4,) with a covariance (4, 4) of so many degrees of freedom.

    The tip's own law has the force F^ = 4/(1 - nu) G* A^ there, G* interpolated between the lines: of several
    interpolations the one nearest to the measured force counts. p is that of |difference|^2/(2 std^2), which is
    distributed as F with 2 and `freedom` degrees of freedom.
    """
    from scipy.stats import f as fisher

    measured_force, depth, area, higher_area = phasors
    inertia = moduli.recording.tip_mass * (2 * math.pi * frequency) ** 2  # [N/m]
    contact_force = measured_force + inertia * depth
    candidates = []
    for shear in _interpolate_modulus(moduli.lines, frequency):
        force_per_area = 4.0 / (1.0 - moduli.lines[0].poisson) * shear
        # Variance of a quadrature of the difference: noise of force, depth and area, and the height of the skin.
        weights = np.array([1.0, inertia, -force_per_area, 0.0])
        noise_variance = float(np.real(weights @ covariance @ weights.conj())) / 2.0
        surface_variance = abs(force_per_area * (higher_area - area)) ** 2
        std = math.sqrt(max(noise_variance + surface_variance, _MIN_VARIANCE))
        expected_force = force_per_area * area
        candidates.append((abs(contact_force - expected_force), std, abs(expected_force)))
    excess, std, expected = min(candidates)
    p = float(fisher.sf(excess**2 / (2 * std**2), 2, freedom))
    return Harmonic(frequency, found=abs(contact_force), expected=float(expected), excess=float(excess), std=std, p=p)


def _interpolate_modulus(lines: Sequence[ModulusLine], frequency: float) -> list[complex]:
    """Return G* [Pa] at a frequency [Hz] by the lines next to it, as a list of one or two possible values.

    Between lines each part goes with a power of the frequency, or linearly with its logarithm where some G' is not
    positive. Of a single line: of constant loss, and as of a Kelvin-Voigt solid.
    """
    if len(lines) == 1:
        shear = lines[0].shear
        return [shear, complex(shear.real, shear.imag * frequency / lines[0].frequency)]
    log_frequencies = np.log([line.frequency for line in lines])
    moduli = np.array([line.shear for line in lines], np.complex128)
    log_frequency = math.log(frequency)
    # The two lines around the frequency; beyond the first or last line they extrapolate.
    right = int(np.clip(np.searchsorted(log_frequencies, log_frequency), 1, len(log_frequencies) - 1))
    share = (log_frequency - log_frequencies[right - 1]) / (log_frequencies[right] - log_frequencies[right - 1])
    low, high = moduli[right - 1], moduli[right]
    if np.min(moduli.real) <= 0:
        return [complex(low + (high - low) * share)]
    return [complex(_interpolate_power(low.real, high.real, share), _interpolate_power(low.imag, high.imag, share))]


def _interpolate_power(low: float, high: float, share: float) -> float:
    """Return the number at a share of the way from `low` to `high`, geometric where both are positive, else linear."""
    return low * (high / low) ** share if low > 0 and high > 0 else low + (high - low) * share


def unexplained_harmonics(moduli: RecordingModuli) -> list[Harmonic]:
    """Return the harmonics beyond those of the tip's own law that exceed the noise and are large enough to matter.

    The level of the test is divided by the number of harmonics (Bonferroni).
    """
    candidates = harmonics(moduli)
    line_forces = [abs(line.shear) * 4 / (1 - line.poisson) * line.area for line in moduli.lines]
    min_excess = _MIN_EXCESS_SHARE * max(line_forces, default=0.0)
    return [
        harmonic
        for harmonic in candidates
        if harmonic.p < _REJECTION_LEVEL / len(candidates) and harmonic.excess > min_excess
    ]
