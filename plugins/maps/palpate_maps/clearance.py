"""How far palpations clear an area: how many patches that may hide now could not hide afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.hidden_patches import Patch
from palpate_maps.stiffness_field import distances

_SITE = 4e-3  # [m] of a line that is one observation


@dataclass(frozen=True)
class PatchGrid:
    """Nodes at which patches may hide, and what patches at one do at another."""

    nodes: Floats  # (m, 2) [m]
    patch: Patch

    @cached_property
    def squares(self) -> Floats:
        """(m, m) rise of the logarithm at nodes by patches at nodes, squared."""
        return np.asarray(self.patch.profile(self.nodes, self.nodes) ** 2)

    @cached_property
    def near(self) -> Floats:
        """(m, m) 1 where nodes are nearer than the patch's radius."""
        return np.asarray(distances(self.nodes, self.nodes) < self.patch.radius, float)


@dataclass(frozen=True)
class Clearance:
    """What palpations of nodes clear of the patches that are expected there.

    A palpation with the variance v at x multiplies the odds of the least patch at z, where there is none, by
    exp(-h(x - z)^2/(2 v)) in the average of their logarithm. So palpations clear sum_z n(z) (1 - exp(-sum h^2/(2 v)))
    of the expected numbers n; nodes that would explain the same patch count as one patch at most.
    """

    grid: PatchGrid
    expected: Floats  # (m,) patches
    std: float  # of a palpation

    @cached_property
    def _left(self) -> Floats:
        return np.asarray(self.expected / (1 + self.grid.near @ self.expected))

    @cached_property
    def _told(self) -> Floats:
        return np.asarray(self.grid.squares / (2 * self.std**2))

    def points(self) -> Floats:
        """(m,) cleared by a point at each node."""
        return np.asarray(-np.expm1(-self._told) @ self._left)

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """(k,) cleared by lines from the first node of a row (k,) to each."""
        step = float(np.hypot(*(self.grid.nodes[row[1]] - self.grid.nodes[row[0]])))
        return np.asarray(-np.expm1(-np.cumsum(self._told[row], axis=0) * (step / _SITE)) @ self._left)

    def after(self, node: int) -> Clearance:
        """What is left to clear once a point at a node was palpated, if no patch is near."""
        return replace(self, expected=self.expected * np.exp(-self._told[node]))
