"""The surface of a press by variable projection: searched on a grid, at which all linear unknowns are solved for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.variable_projection import best_place, linear_part

from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

# The search: choices between time and the chance to miss the valley of the least squares.
_GRID_HEIGHTS = 61
_GRID_BOTTOM = 0.02  # of the travel above the deepest reading, below which no surface is searched
_FINER_LEVELS = 4
_FINER_HEIGHTS = 21  # of each level
_FINER_FACTOR = 10.0  # between the widths of two levels: half of a finer grid's heights on each side
_ADHESION_READINGS = 500  # by which an adhesion is searched
_ADHESION_RANGE = 300.0  # times more and less than the law's adhesion
_ADHESION_RATIOS = 9
_MIN_SIZE = 1e-300  # guards against a division by 0


@dataclass(frozen=True)
class LinearModel:
    """The force as a sum of k columns times linear unknowns, at any height of the surface.

    The unknowns are the modulus, the offset of the baseline, and, where they are requested, its tilt and a viscosity.
    """

    law: ElasticLaw
    branch: Branch
    tilt: bool
    viscous: bool
    touching: NDArray[np.bool_] | None = None  # (n,) readings in contact, where they do not follow from the surface

    @property
    def unknown_names(self) -> list[str]:
        """Names (k,) of the unknowns, after which the fields of `CurveFit` are called."""
        names = ["modulus", "offset"]
        if self.tilt:
            names.append("tilt")
        if self.viscous:
            names.append("viscosity")
        return names

    def columns_at(self, surface: float, adhesion_factor: float = 1.0) -> tuple[Floats, Floats]:
        """Return the columns (n, k) at a surface [m], and the force (n,) [N] less that of the held parameters.

        The adhesion is that of the law times a factor.
        """
        law, depth = self.law, surface - self.branch.height
        if adhesion_factor != 1.0:
            law = replace(law, adhesion=adhesion_factor * law.adhesion)
        if self.touching is None:
            geometry = law.geometry(depth)
        else:
            geometry = np.where(self.touching, law.contact_geometry(depth), 0.0)
        columns = [geometry, np.ones(len(self.branch))]
        if self.tilt:
            columns.append(self.branch.height - surface)
        if self.viscous:
            columns.append(self.law.damping(depth, self.branch.rate))
        return np.column_stack(columns), self.branch.force - self.law.held_force(depth, self.branch.rate)

    def sizes(self, modulus: float) -> Floats:
        """Return the sizes (k,) of the unknowns, by the ranges of force, height and rate, and a modulus."""
        force_range = float(np.ptp(self.branch.force))
        max_rate = float(np.max(np.abs(self.branch.rate)))
        travel = float(np.ptp(self.branch.height))
        modulus_size = max(abs(modulus), _MIN_SIZE)
        sizes = [modulus_size, force_range]
        if self.tilt:
            sizes.append(force_range / travel)
        if self.viscous:
            sizes.append(modulus_size * travel / max(max_rate, _MIN_SIZE))
        return np.array(sizes)


@dataclass(frozen=True)
class SurfaceCandidate:
    """A height of the surface with the linear unknowns that fit best at it."""

    squares: float  # [N^2]; infinite where the modulus is not above 0
    unknowns: Floats  # (k,)
    surface: float  # [m]


def best_surface(model: LinearModel) -> SurfaceCandidate:
    """Return the surface of the least squares: on a grid over the travel, then on finer ones about the best height."""
    heights = _grid(model.branch)
    best = _best_candidate(model, heights)
    half_width = float(np.ptp(heights)) / (_GRID_HEIGHTS - 1)
    for _ in range(_FINER_LEVELS):
        finer_heights = best.surface + np.linspace(-half_width, half_width, _FINER_HEIGHTS)
        best = min(best, _best_candidate(model, finer_heights), key=lambda candidate: candidate.squares)
        half_width /= _FINER_FACTOR
    return best


def _best_candidate(model: LinearModel, heights: Iterable[float]) -> SurfaceCandidate:
    """Return the best of some heights [m] of the surface; the first of equal ones."""
    candidates = (_surface_candidate(model, float(height)) for height in heights)
    return min(candidates, key=lambda candidate: candidate.squares)


def _grid(branch: Branch) -> Floats:
    """Return the heights (m,) [m] at which the surface is searched, from near the deepest reading to the highest."""
    low, high = float(branch.height.min()), float(branch.height.max())
    return np.linspace(low + _GRID_BOTTOM * (high - low), high, _GRID_HEIGHTS)


def _surface_candidate(model: LinearModel, surface: float) -> SurfaceCandidate:
    """Return the linear unknowns that fit best at a surface [m]; a modulus below 0 does not count."""
    solution = linear_part(*model.columns_at(surface))
    squares = solution.squares if solution.unknowns[0] > 0 else np.inf
    return SurfaceCandidate(squares, solution.unknowns, surface)


def with_best_adhesion(model: LinearModel) -> LinearModel:
    """Return the model with the adhesion of the least squares, searched together with the surface on a few readings."""
    stride = max(len(model.branch) // _ADHESION_READINGS, 1)
    thin_branch = model.branch.select(slice(None, None, stride))

    def with_adhesion(adhesion: float, branch: Branch) -> LinearModel:
        return replace(model, law=replace(model.law, adhesion=adhesion), branch=branch)

    def squares(adhesion: float, surface: float, _: int) -> float:
        return _surface_candidate(with_adhesion(adhesion, thin_branch), surface).squares

    adhesions = model.law.adhesion * _ADHESION_RANGE ** np.linspace(-1.0, 1.0, _ADHESION_RATIOS)
    best_adhesion, _ = best_place(squares, adhesions, _grid(thin_branch))
    return with_adhesion(best_adhesion, model.branch)
