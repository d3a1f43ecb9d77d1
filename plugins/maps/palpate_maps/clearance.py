"""How far palpations clear an area: how many patches that may hide now could not hide afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.hidden_patches import Patch
from palpate_maps.stiffness_field import lengths_along

_SITE = 4e-3  # [m] of a line that is one observation


@dataclass(frozen=True)
class PatchGrid:
    """Nodes at which patches may hide, and what patches at one do at another."""

    nodes: Floats  # (m, 2) [m], or (m, 3) on a surface
    patch: Patch

    @cached_property
    def squares(self) -> Floats:
        """(m, m) rise of the logarithm at nodes by patches at nodes, squared."""
        return np.asarray(self.patch.profile(self.nodes, self.nodes) ** 2)


@dataclass(frozen=True)
class Clearance:
    """How far palpations of nodes go towards a number of patches that may remain.

    A palpation with the variance v at x multiplies the odds of the least patch at z, where none is, by
    exp(-h(x - z)^2/(2 v)) in the average of their logarithm. The logarithm of an expected number n(z) over the number
    that may remain there is what is left to do at z; it is done in any order, so that it counts the same for all
    places: palpations gain sum_z min(log n(z)/allowed, sum h^2/(2 v)).
    """

    grid: PatchGrid
    left: Floats  # (m,) logarithm of the expected over the allowed number, 0 where that is lower
    std: float  # of a palpation

    @classmethod
    def of(cls, grid: PatchGrid, expected: Floats, risk: float, std: float) -> Clearance:
        """Where patches (m,) are expected, until their number is a risk."""
        allowed = risk / max(int(np.count_nonzero(expected)), 1)
        return cls(grid, np.log(np.maximum(expected / allowed, 1.0)), std)

    @cached_property
    def _told(self) -> Floats:
        return np.asarray(self.grid.squares / (2 * self.std**2))

    def points(self) -> Floats:
        """(m,) gained by a point at each node."""
        return np.asarray(np.minimum(self._told, self.left).sum(axis=1))

    def sites(self) -> Floats:
        """(m,) gained by one site of a line at each node, which is at most that of a point."""
        return self.points()

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """(k,) gained by lines from the first node of a row (k,) to each."""
        way = lengths_along(self.grid.nodes, row)
        step: Any = way[1]
        if self.grid.nodes.shape[1] > 2:  # on a surface steps differ: their mean as far as each node
            step = (np.r_[step, way[1:] / np.arange(1, len(row))])[:, None]
        return np.asarray(np.minimum(np.cumsum(self._told[row], axis=0) * (step / _SITE), self.left).sum(axis=1))

    def after(self, node: int) -> Clearance:
        """What is left to gain once a point at a node was palpated, if no patch is near."""
        return replace(self, left=np.maximum(self.left - self._told[node], 0.0))
