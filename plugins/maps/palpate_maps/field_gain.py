"""How much less uncertain palpations make a field, or where it is above a level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.gaussian_process import cholesky_factor, whiten

from palpate_maps.next_places import Knowledge

_COUNTED = 400  # places at most that the gain is summed over


@dataclass(frozen=True)
class FieldGain:
    """Sum over places j of a weight times the share of their variance that palpations take away.

    Palpations of places S with variances r leave C_jj - C_jS (C_SS + r)^-1 C_Sj; a line's are taken up one after the
    other by the Cholesky factor of C_SS + r.
    """

    own: Floats  # (m, m) covariances of nodes
    cross: Floats  # (m, n) with the places
    weight: Floats  # (n,) over the places' variance
    point: float  # variance of a point
    line: float  # of a site of a line

    @classmethod
    def of(cls, known: Knowledge, rows: NDArray[np.intp], weight: Floats) -> FieldGain:
        """Of palpations at some of the field's nodes (m,), with a weight for each of them all."""
        field = known.field
        counted = np.argsort(-weight, kind="stable")[: 4 * _COUNTED]
        counted = np.sort(counted[:: max(len(counted) // _COUNTED, 1)])
        variance, noise = field.std[counted] ** 2, field.kernel.noise
        cross, own = field.covariance(rows, counted), field.covariance(rows, rows)
        point, line = (noise + known.typical_std(standing) ** 2 for standing in (True, False))
        return cls(own, cross, weight[counted] / variance, point, line)

    def points(self) -> Floats:
        """(m,) of a point at each node."""
        return np.asarray(self.cross**2 @ self.weight / (np.diag(self.own) + self.point))

    def sites(self) -> Floats:
        """(m,) of one site of a line at each node."""
        return np.asarray(self.cross**2 @ self.weight / (np.diag(self.own) + self.line))

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """(k,) of lines from the first node of a row (k,) to each."""
        solved = whiten(cholesky_factor(self.own[np.ix_(row, row)], self.line), self.cross[row])
        return np.asarray(np.cumsum(solved**2 @ self.weight))

    def after(self, node: int) -> FieldGain:
        """What is left to gain once a point was palpated at a node."""
        share = self.own[node] / (self.own[node, node] + self.point)
        own, cross = self.own - np.outer(share, self.own[node]), self.cross - np.outer(share, self.cross[node])
        return replace(self, own=own, cross=cross)
