"""Decrease of the variance of a field by palpations, or of the uncertainty of the places above a level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.gaussian_process import cholesky_factor, whiten

from palpate_maps.next_places import Knowledge

_MAX_SUMMED = (
    400  # places that the gain is summed over, of the 4 times as many of the largest weights: a choice of time
)


@dataclass(frozen=True)
class FieldGain:
    """Sum over places j of a weight times the share of their variance that palpations take away.

    Palpations of places S with variances r leave C_jj - C_jS (C_SS + r)^-1 C_Sj; a line's are taken up one after the
    other by the Cholesky factor of C_SS + r.
    """

    between: Floats  # (m, m) covariances of nodes
    cross: Floats  # (m, n) with the places
    weight: Floats  # (n,) over the places' variance
    point: float  # variance of a point
    line: float  # of a site of a line

    @classmethod
    def of(cls, known: Knowledge, rows: NDArray[np.intp], weight: Floats) -> FieldGain:
        """Return the gain of palpations at some of the field's nodes (m,), with a weight for each of all nodes."""
        field = known.field
        # The places of the largest weights, evenly thinned in the order of these.
        summed = np.argsort(-weight, kind="stable")[: 4 * _MAX_SUMMED]
        summed = np.sort(summed[:: max(len(summed) // _MAX_SUMMED, 1)])
        relative_weight = weight[summed] / field.std[summed] ** 2
        noise = field.kernel.noise
        return cls(
            between=field.covariance(rows, rows),
            cross=field.covariance(rows, summed),
            weight=relative_weight,
            point=noise + known.typical_std(True) ** 2,
            line=noise + known.typical_std(False) ** 2,
        )

    def points(self) -> Floats:
        """Return the gain (m,) of a point at each node."""
        return np.asarray(self.cross**2 @ self.weight / (np.diag(self.between) + self.point))

    def sites(self) -> Floats:
        """Return the gain (m,) of one site of a line at each node."""
        return np.asarray(self.cross**2 @ self.weight / (np.diag(self.between) + self.line))

    def lines(self, row: NDArray[np.intp]) -> Floats:
        """Return the gain (k,) of lines from the first node of a row (k,) to each."""
        solved = whiten(cholesky_factor(self.between[np.ix_(row, row)], self.line), self.cross[row])
        return np.asarray(np.cumsum(solved**2 @ self.weight))

    def after(self, node: int) -> FieldGain:
        """Return the gain once a point was palpated at a node."""
        share = self.between[node] / (self.between[node, node] + self.point)
        between = self.between - np.outer(share, self.between[node])
        return replace(self, between=between, cross=self.cross - np.outer(share, self.cross[node]))
