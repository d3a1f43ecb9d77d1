"""Where to palpate so that fewest patches may still hide: points and short lines, by what they clear in a second."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.hidden_patches import Patch
from palpate_maps.search_motion import SearchMotion
from palpate_maps.stiffness_field import distances

_SITE = 4e-3  # [m] of a line that is one observation


@dataclass(frozen=True)
class SearchAction:
    """A point, or a line: what it clears, and what it takes."""

    start: int  # node
    end: int | None
    cleared: float  # patches that are expected to hide now, and not afterwards
    seconds: float

    @property
    def worth(self) -> float:
        """Cleared in a second."""
        return self.cleared / self.seconds


@dataclass(frozen=True)
class Clearance:
    """What points and lines over nodes clear, at which patches may hide.

    A palpation with the variance v at x multiplies the odds of the least patch at z, where there is none, by
    exp(-h(x - z)^2/(2 v)) in the average of their logarithm. So palpations clear sum_z n(z) (1 - exp(-sum h^2/(2 v)))
    of the expected numbers n; nodes that would explain the same patch count as one patch at most.
    """

    nodes: Floats  # (m, 2) [m]
    patch: Patch
    motion: SearchMotion

    @cached_property
    def _squares(self) -> Floats:
        return np.asarray(self.patch.profile(self.nodes, self.nodes) ** 2)

    @cached_property
    def _near(self) -> Floats:
        return np.asarray(distances(self.nodes, self.nodes) < self.patch.radius, float)

    @cached_property
    def _rows(self) -> list[NDArray[np.intp]]:
        """Nodes beside one another along each axis, in their order."""
        pieces = []
        for axis in (0, 1):
            across = np.round(self.nodes[:, 1 - axis], 7)
            for key in np.unique(across):
                row = np.flatnonzero(across == key)
                row = row[np.argsort(self.nodes[row, axis], kind="stable")]
                gaps = np.diff(self.nodes[row, axis])
                pieces += np.split(row, np.flatnonzero(gaps > 1.5 * self.patch.radius) + 1)
        return [piece for piece in pieces if len(piece) > 1]

    def best(self, expected: Floats, std: float, closed: NDArray[np.bool_]) -> SearchAction | None:
        """The point or line that clears most in a second, by palpations of a standard deviation; no closed point."""
        left = expected / (1 + self._near @ expected)
        told = self._squares / (2 * std**2)
        actions: list[SearchAction] = []
        rows = np.flatnonzero(~closed)
        if len(rows):
            cleared = -np.expm1(-told[rows]) @ left
            k = int(np.argmax(cleared))
            actions.append(SearchAction(int(rows[k]), None, float(cleared[k]), self.motion.first_point))
        if self.motion.line_speed is not None:
            actions += [action for row in self._rows if (action := self._line(row, told, left)) is not None]
        return max(actions, key=lambda action: action.worth, default=None)

    def after(self, expected: Floats, node: int, std: float) -> Floats:
        """(m,) what would hide after a palpation at a node, if no patch is near."""
        return np.asarray(expected * np.exp(-self._squares[node] / (2 * std**2)))

    def _line(self, row: NDArray[np.intp], told: Floats, left: Floats) -> SearchAction | None:
        """The best line along a row of nodes."""
        along = np.hypot(*(self.nodes[row] - self.nodes[row[0]]).T)
        step = along[1] - along[0]
        sums = np.vstack([np.zeros(told.shape[1]), np.cumsum(told[row], axis=0)]) * (step / _SITE)
        first, last = np.triu_indices(len(row), max(int(np.ceil(self.motion.shortest / step)), 1))
        if len(row) > 12:  # a longer line from every second node is as good
            even = (first % 2 == 0) & ((last - first) % 2 == 0)
            first, last = first[even], last[even]
        if not len(first):
            return None
        cleared = -np.expm1(-(sums[last + 1] - sums[first])) @ left
        seconds = self.motion.seconds_along(along[last] - along[first])
        k = int(np.argmax(cleared / seconds))
        return SearchAction(int(row[first[k]]), int(row[last[k]]), float(cleared[k]), float(seconds[k]))
