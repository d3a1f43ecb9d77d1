"""Clearance of an area by palpations: the number of patches that may hide now and could not afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.hidden_patches import Patch
from palpate_maps.stiffness_field import lengths_along

_SITE_LENGTH = 4e-3  # [m] of a line that is one observation: the width of a site of `LumpSettings`


@dataclass(frozen=True)
class PatchGrid:
    """Nodes at which patches may hide, and the rise of the logarithm at one by a patch at another."""

    nodes: Floats  # (m, 2) [m], or (m, 3) on a surface
    patch: Patch

    @cached_property
    def squares(self) -> Floats:
        """(m, m) rise of the logarithm at nodes by patches at nodes, squared."""
        return np.asarray(self.patch.profile(self.nodes, self.nodes) ** 2)


@dataclass(frozen=True)
class Clearance:
    """Progress of palpations of nodes towards a number of patches that may remain.

    A palpation with the variance v at x multiplies the odds of the least patch at z, where none is, by
    exp(-h(x - z)^2/(2 v)) in the average of their logarithm. The logarithm of an expected number n(z) over the number
    that may remain there is what is left to do at z; it is done in any order, so that it counts the same for all
    places: palpations gain sum_z min(log n(z)/allowed, sum h^2/(2 v)).
    """

    grid: PatchGrid
    excess: Floats  # (m,) logarithm of the expected over the allowed number, 0 where that is lower
    std: float  # of a palpation

    @classmethod
    def of(cls, grid: PatchGrid, expected: Floats, risk: float, std: float) -> Clearance:
        """Return the gain by the number of patches (m,) expected at each node, until their sum is a risk."""
        allowed = risk / max(int(np.count_nonzero(expected)), 1)
        return cls(grid, np.log(np.maximum(expected / allowed, 1.0)), std)

    @cached_property
    def _decrease(self) -> Floats:
        """(m, m) decrease of the logarithm of the odds at nodes by a palpation at nodes: h^2/(2 v)."""
        return np.asarray(self.grid.squares / (2 * self.std**2))

    def points(self) -> Floats:
        """Return the gain (m,) of a point at each node."""
        return np.asarray(np.minimum(self._decrease, self.excess).sum(axis=1))

    def sites(self) -> Floats:
        """Return the gain (m,) of one site of a line at each node, which is at most that of a point."""
        return self.points()

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """Return the gain (k,) of lines from the first node of a row (k,) to each."""
        way = lengths_along(self.grid.nodes, row)
        step: Any = way[1]
        if self.grid.nodes.shape[1] > 2:  # on a surface steps differ: their mean as far as each node
            step = (np.r_[step, way[1:] / np.arange(1, len(row))])[:, None]
        decrease = np.cumsum(self._decrease[row], axis=0) * (step / _SITE_LENGTH)
        return np.asarray(np.minimum(decrease, self.excess).sum(axis=1))

    def after(self, node: int) -> Clearance:
        """Return the clearance once a point at a node was palpated, if no patch is near."""
        return replace(self, excess=np.maximum(self.excess - self._decrease[node], 0.0))
