"""The modulus over depth: from the contact point on, and by itself within windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_indentation.approach_fit import CurveFit, correlation_time
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_MIN_SAMPLES = 8  # in a bin or window, a choice: the scatter of fewer shows no uncertainty
_SURFACE_STEP = 1e-3  # of the deepest depth, a choice between curvature and readings that change their bin
_MAX_CORRELATION_SHARE = 0.25  # of a window's samples, a choice: a longer correlation time is not seen within it

# Modulus of some readings by force (n,) [N] and geometry (n,), and its standard uncertainty by noise.
_Estimate = Callable[[Floats, Floats], tuple[float, float]]


@dataclass(frozen=True)
class ModulusProfile:
    """A modulus at depths, (m,) each."""

    begin: Floats  # [m]
    end: Floats  # [m]
    modulus: Floats
    noise: Floats  # standard uncertainty by the scatter of the force and of the baseline
    contact: Floats  # standard uncertainty by the contact point; common to all, of the sign of `by_surface`
    by_surface: Floats  # derivative by the height of the surface [unit/m]

    @property
    def depth(self) -> Floats:
        """Middles [m] of the depths."""
        return 0.5 * (self.begin + self.end)

    @property
    def std(self) -> Floats:
        """Combined standard uncertainty."""
        return np.hypot(self.noise, self.contact)


def secant_profile(law: ElasticLaw, branch: Branch, fit: CurveFit, bins: int) -> ModulusProfile:
    """Return E(d) = sum F G/sum G^2 in bins of depth, from the contact point of the fit on."""
    return _profile(law, branch, fit, bins, partial(_secant_modulus, fit))


def _secant_modulus(fit: CurveFit, force: Floats, geometry: Floats) -> tuple[float, float]:
    """Return F/G by least squares, and its uncertainty by the noise and the offset of the fit's baseline."""
    power = float(geometry @ geometry)
    correlation = min(fit.correlation_time, float(len(force)))
    by_offset = fit.offset_std * float(geometry.sum()) / power
    return float(geometry @ force) / power, np.hypot(fit.rms * np.sqrt(correlation / power), by_offset)


def tangent_profile(law: ElasticLaw, branch: Branch, fit: CurveFit, windows: int) -> ModulusProfile:
    """Return E by the slope of force over G(d) within windows of depth, each with an offset of its own."""
    return _profile(law, branch, fit, windows, _tangent_modulus)


def _tangent_modulus(force: Floats, geometry: Floats) -> tuple[float, float]:
    """Return the slope of a line of force over geometry, and its uncertainty by the scatter about the line."""
    count = len(force)
    centred_geometry, centred_force = geometry - geometry.mean(), force - force.mean()
    power = float(centred_geometry @ centred_geometry)
    modulus = float(centred_geometry @ centred_force) / power
    residual = centred_force - modulus * centred_geometry
    correlation = min(correlation_time(residual), _MAX_CORRELATION_SHARE * count)
    variance = max(float(residual @ residual) / max(count - 2 * correlation, 1.0), 0.0)
    return modulus, np.sqrt(variance * max(correlation, 1.0) / power)


def change_over_depth(law: ElasticLaw, branch: Branch, fit: CurveFit) -> tuple[float, float]:
    """Return the relative rise of the tangent modulus from the shallower to the deeper half, and its uncertainty."""
    halves = tangent_profile(law, branch, fit, windows=2)
    shallow, deep = halves.modulus.tolist()
    by_noise = float(np.hypot(*halves.noise))
    by_contact = abs(float(halves.by_surface[1] - halves.by_surface[0])) * fit.surface_std
    return (deep - shallow) / fit.modulus, float(np.hypot(by_noise, by_contact)) / abs(fit.modulus)


def _profile(law: ElasticLaw, branch: Branch, fit: CurveFit, count: int, estimate: _Estimate) -> ModulusProfile:
    """Return the modulus in so many equal ranges of depth; its derivative by the surface is a central difference."""
    edges = np.linspace(0.0, float((fit.surface - branch.height).max()), count + 1)
    step = _SURFACE_STEP * float(edges[-1])
    modulus, noise = _moduli(law, branch, fit, fit.surface, edges, estimate)
    above, _ = _moduli(law, branch, fit, fit.surface + step, edges, estimate)
    below, _ = _moduli(law, branch, fit, fit.surface - step, edges, estimate)
    by_surface = (above - below) / (2 * step)
    return ModulusProfile(edges[:-1], edges[1:], modulus, noise, np.abs(by_surface) * fit.surface_std, by_surface)


def _moduli(
    law: ElasticLaw, branch: Branch, fit: CurveFit, surface: float, edges: Floats, estimate: _Estimate
) -> tuple[Floats, Floats]:
    """Return modulus and uncertainty by noise (m,) between edges (m + 1,) of the depth [m] below a surface [m].

    The force is without the baseline of the fit and the held parameters. NaN between edges with too few readings.
    """
    depth = surface - branch.height
    force = branch.force - fit.baseline(branch.height) - law.held_force(depth, branch.rate)
    geometry = law.geometry(depth)
    modulus, noise = np.full(len(edges) - 1, np.nan), np.full(len(edges) - 1, np.nan)
    for i, (low, high) in enumerate(pairwise(edges.tolist())):
        rows: NDArray[np.bool_] = (depth > low) & (depth <= high)
        if np.count_nonzero(rows) >= _MIN_SAMPLES:
            modulus[i], noise[i] = estimate(force[rows], geometry[rows])
    return modulus, noise
