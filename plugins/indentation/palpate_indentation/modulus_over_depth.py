"""The modulus over depth: from the contact point on, and by itself within windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_indentation.approach_fit import CurveFit, correlation_time
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_FEWEST = 8  # samples in a bin or window
_STEP = 1e-3  # of the deepest depth, by which derivatives by the contact point are taken


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
        """Middles [m]."""
        return 0.5 * (self.begin + self.end)

    @property
    def std(self) -> Floats:
        """Combined standard uncertainty."""
        return np.hypot(self.noise, self.contact)


def secant_profile(law: ElasticLaw, branch: Branch, fit: CurveFit, bins: int) -> ModulusProfile:
    """E(d) = F/G(d) in bins of depth, from the contact point of the fit on: what a single reading would say there."""

    def values(surface: float) -> tuple[Floats, Floats]:
        depth, force, geometry = _corrected(law, branch, fit, surface)
        found, noise = np.full(bins, np.nan), np.full(bins, np.nan)
        for i, rows in enumerate(_rows(depth, edges)):
            if np.count_nonzero(rows) >= _FEWEST:
                g, f = geometry[rows], force[rows]
                power = float(g @ g)
                found[i] = float(g @ f) / power
                time = min(fit.correlation_time, float(rows.sum()))
                noise[i] = np.hypot(fit_noise * np.sqrt(time / power), fit.offset_std * float(g.sum()) / power)
        return found, noise

    edges = np.linspace(0.0, float((fit.surface - branch.height).max()), bins + 1)
    fit_noise = fit.rms
    return _profile(values, edges, fit.surface, fit.surface_std)


def tangent_profile(law: ElasticLaw, branch: Branch, fit: CurveFit, windows: int) -> ModulusProfile:
    """E by the slope of force over G(d) within windows of depth, each with an offset of its own."""

    def values(surface: float) -> tuple[Floats, Floats]:
        depth, force, geometry = _corrected(law, branch, fit, surface)
        found, noise = np.full(windows, np.nan), np.full(windows, np.nan)
        for i, rows in enumerate(_rows(depth, edges)):
            count = int(np.count_nonzero(rows))
            if count < _FEWEST:
                continue
            g, f = geometry[rows] - geometry[rows].mean(), force[rows] - force[rows].mean()
            power = float(g @ g)
            found[i] = float(g @ f) / power
            left = f - found[i] * g
            time = min(correlation_time(left), 0.25 * count)
            noise[i] = np.sqrt(max(float(left @ left) / max(count - 2 * time, 1.0), 0.0) * max(time, 1.0) / power)
        return found, noise

    edges = np.linspace(0.0, float((fit.surface - branch.height).max()), windows + 1)
    return _profile(values, edges, fit.surface, fit.surface_std)


def change_over_depth(law: ElasticLaw, branch: Branch, fit: CurveFit) -> tuple[float, float]:
    """Relative rise of the tangent modulus from the shallower to the deeper half of the depth, and its uncertainty."""
    halves = tangent_profile(law, branch, fit, 2)
    shallow, deep = halves.modulus.tolist()
    noise = float(np.hypot(*halves.noise))
    by_contact = abs(float(halves.by_surface[1] - halves.by_surface[0])) * fit.surface_std
    return (deep - shallow) / fit.modulus, float(np.hypot(noise, by_contact)) / abs(fit.modulus)


def _corrected(law: ElasticLaw, branch: Branch, fit: CurveFit, surface: float) -> tuple[Floats, Floats, Floats]:
    depth = surface - branch.height
    force = branch.force - fit.baseline(branch.height) - law.rest(depth, branch.rate)
    return depth, force, law.geometry(depth)


def _rows(depth: Floats, edges: Floats) -> list[NDArray[np.bool_]]:
    return [(depth > low) & (depth <= high) for low, high in pairwise(edges.tolist())]


def _profile(
    values: Callable[[float], tuple[Floats, Floats]], edges: Floats, surface: float, surface_std: float
) -> ModulusProfile:
    step = _STEP * float(edges[-1])
    found, noise = values(surface)
    by_surface = (values(surface + step)[0] - values(surface - step)[0]) / (2 * step)
    return ModulusProfile(edges[:-1], edges[1:], found, noise, np.abs(by_surface) * surface_std, by_surface)
