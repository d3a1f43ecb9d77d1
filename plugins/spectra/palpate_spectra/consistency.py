"""What a spectrum must obey whatever the material: Kramers and Kronig's relations, and the tip's own harmonics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

from palpate_spectra.complex_moduli import ModulusLine, RecordingModuli
from palpate_spectra.joint_covariance import Attempt, fit_jointly, stack_moduli

_PER_DECADE = 6  # relaxation times of the test
_BEYOND = 30.0  # times the frequencies' range, to either side
_LEVEL = 1e-3  # of a test's p
_MATTERS = 0.01  # of the largest line of the force


@dataclass(frozen=True)
class Consistency:
    """How far moduli are from those of any passive linear material."""

    chi2: float
    freedom: int  # 0: so few frequencies that anything fits
    p: float

    @property
    def failed(self) -> bool:
        """True if they are of none."""
        return self.freedom > 0 and self.p < _LEVEL


@dataclass(frozen=True)
class Harmonic:
    """The force at a sum or difference of the lines, against what the tip's own law makes there."""

    frequency: float  # [Hz]
    found: float  # [N]
    expected: float  # [N]
    excess: float  # [N] of the difference of the phasors
    std: float  # [N] of its quadratures
    p: float


def kramers_kronig(lines: Sequence[ModulusLine]) -> Consistency:
    """Return True if G' and G'' belong to one causal, passive, linear material.

    Every such material is a spring, a dashpot and Maxwell arms of positive strengths side by side, so that least
    squares with non-negative strengths over a dense grid of times leaves the noise and no more (Boukamp 1995, with the
    sign that mechanics gives; Lawson and Hanson 1974). A wrong mass, compliance or timing is beyond what it can follow.
    """
    from scipy.optimize import nnls
    from scipy.stats import chi2

    omega = 2 * np.pi * np.array([line.frequency for line in lines])
    decades = math.log10(_BEYOND**2 * omega.max() / omega.min())
    times = np.geomspace(1 / (_BEYOND * omega.max()), _BEYOND / omega.min(), math.ceil(_PER_DECADE * decades))
    turned = 1j * np.outer(omega, times)
    basis = np.column_stack([np.ones(len(omega)), 1j * omega, turned / (1 + turned)])
    both, moduli, strengths = np.vstack([basis.real, basis.imag]), stack_moduli(lines), np.zeros(basis.shape[1])

    def attempt(half: Floats, _rounds: int) -> Attempt:
        white = np.linalg.solve(half, both)
        sizes = np.linalg.norm(white, axis=0)
        strengths[:] = nnls(white / sizes, np.linalg.solve(half, moduli))[0] / sizes
        slopes: Any = both[:, strengths > 0]
        prediction: Any = basis @ strengths
        return Attempt(moduli - both @ strengths, slopes, prediction)

    joint = fit_jointly(lines, attempt)
    # Neighbouring times share a strength: together they are one arm, of a time between theirs.
    active = strengths[:2] > 0
    arms = np.flatnonzero(np.diff(np.concatenate([[0], (strengths[2:] > 0).astype(int)])) == 1)
    freedom = max(2 * len(lines) - int(active.sum()) - 2 * len(arms) - joint.scatter.parts, 0)
    return Consistency(joint.chi2, freedom, float(chi2.sf(joint.chi2, freedom)) if freedom else math.nan)


def harmonics(answer: RecordingModuli) -> list[Harmonic]:
    """Return the force at the sums and differences of the lines; nothing of a motion whose frequency changes.

    The tip's own law makes F^ = 4/(1 - nu) G* A^ there, too, G* taken between the lines.
    """
    from scipy.stats import f as fisher

    mixed, recorded = answer.mixed, answer.recorded
    if mixed is None or not len(mixed.frequencies):
        return []
    found = []
    for frequency, phasors, covariance, freedom in zip(
        mixed.frequencies.tolist(), mixed.phasors, mixed.covariances, mixed.freedom.tolist(), strict=True
    ):
        omega = 2 * math.pi * frequency
        inertia = recorded.tip_mass * omega**2
        force = phasors[0] + inertia * phasors[1]
        tried = []
        for shear in _between(answer.lines, frequency):
            per_area = 4.0 / (1.0 - answer.lines[0].poisson) * shear
            weights = np.array([1.0, inertia, -per_area, 0.0])
            noise = float(np.real(weights @ covariance @ weights.conj())) / 2.0
            shifted = abs(per_area * (phasors[3] - phasors[2])) ** 2
            excess, std = abs(force - per_area * phasors[2]), math.sqrt(max(noise + shifted, 1e-300))
            tried.append((excess, std, abs(per_area * phasors[2])))
        excess, std, expected = min(tried)
        p = float(fisher.sf(excess**2 / (2 * std**2), 2, freedom))
        found.append(Harmonic(frequency, abs(force), float(expected), float(excess), std, p))
    return found


def _between(lines: Sequence[ModulusLine], frequency: float) -> list[complex]:
    """G* [Pa] at a frequency by the lines next to it; of one line as a solid, and as one of constant loss angle."""
    known = np.log([line.frequency for line in lines])
    if len(lines) == 1:
        g = lines[0].shear
        return [g, complex(g.real, g.imag * frequency / lines[0].frequency)]
    values = np.array([line.shear for line in lines], np.complex128)
    at = math.log(frequency)
    right = int(np.clip(np.searchsorted(known, at), 1, len(known) - 1))
    share = (at - known[right - 1]) / (known[right] - known[right - 1])
    low, high = values[right - 1], values[right]
    return [complex(low + (high - low) * share) if np.min(values.real) <= 0 else _power(low, high, share)]


def _power(low: complex, high: complex, share: float) -> complex:
    """Between two moduli, each part by a power of the frequency where it is positive."""
    parts = []
    for a, b in ((low.real, high.real), (low.imag, high.imag)):
        parts.append(a * (b / a) ** share if a > 0 and b > 0 else a + (b - a) * share)
    return complex(*parts)


def unexplained_harmonics(answer: RecordingModuli) -> list[Harmonic]:
    """Harmonics beyond those of the tip's own law that are clear of noise and large enough to matter."""
    tried = harmonics(answer)
    largest = max((abs(line.shear) * 4 / (1 - line.poisson) * line.area for line in answer.lines), default=0.0)
    return [one for one in tried if one.p < _LEVEL / len(tried) and one.excess > _MATTERS * largest]
