"""Proposals of the next places, from the knowledge of an area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.baseline_sites import Baseline, background_sites
from palpate_maps.lump_criteria import Lump
from palpate_maps.sites import Sites, merge_sites
from palpate_maps.stiffness_field import StiffnessField, distances

Aim = Literal["find", "outline", "map"]

SETTLED = 4e-3  # [m] by which a round may move a lump that is in place: the width of a site
_SITE_LENGTH = 3e-3  # [m] of a sweep that is one observation of the field: a choice, so that a line has few of them
_SITE_SPREAD = 0.005  # standard deviation of the logarithm between sites: that of `LumpSettings`
_NODE_DISTANCE = 1e-3  # [m] of a grid over what was palpated: the spacing of sites
_MAX_NODES = 60  # along each of its axes: a choice of time


@dataclass(frozen=True)
class Proposal:
    """A place to palpate next, or a line from there to its end, and why."""

    place: tuple[float, float]  # [m]
    contrast: float  # expected there, over the baseline; on a line, where that is largest
    std: float  # of it
    suspicion: float  # probability of a contrast above the threshold
    end: tuple[float, float] | None = None  # [m] of a line


def lumps_apart(a: Lump, b: Lump, lift: Callable[[Floats], Floats] = np.asarray) -> float:
    """Return the distance [m] of the middles of two lumps, over a surface that lifts places (n, 2) [m] to it."""
    return float(np.hypot.reduce(np.subtract(*lift(np.array([a.place, b.place])))))


def is_placed(
    before: Lump | None, now: Lump | None, sure: float, lift: Callable[[Floats], Floats] = np.asarray
) -> bool:
    """Return True if a lump is placed: its p-value is below `sure`, and a round of visits moved it by less than a site.

    A point on the flank of a lump is significant, too; the lump is placed once another round of visits leaves it there.
    """
    if before is None or now is None or now.p >= sure:
        return False
    return lumps_apart(now, before, lift) < SETTLED


@dataclass
class Knowledge:
    """Knowledge of an area: the sites, their baseline, and the field over the places that may be visited."""

    known: Sites
    base: Baseline
    field: StiffnessField

    @classmethod
    def of(cls, sites: Sites, nodes: Floats | None = None, before: Knowledge | None = None) -> Knowledge:
        """Return the knowledge by the sites of a path; `before` is what was known before the latest of them."""
        known = merge_sites(sites, _SITE_LENGTH)
        base = background_sites(known, _SITE_SPREAD)
        if before is not None:
            return cls(known, base, before.field.update(known, base.mean))
        nodes = _nodes(known.place) if nodes is None else nodes
        return cls(known, base, StiffnessField.of(known, nodes, base.mean))

    def expectation(self, contrast: float) -> tuple[Floats, Floats, Floats]:
        """Return (m,) each: mean and deviation of the height over the baseline, probability of a contrast above."""
        from scipy.special import ndtr

        height = self.field.mean(self.base.mean) - self.base.mean
        spread = np.hypot(self.field.std, self.base.spread / np.sqrt(self.base.count))
        return height, spread, ndtr((height - np.log1p(contrast)) / spread)

    def typical_std(self, standing: bool) -> float:
        """Return the standard deviation of the logarithm at a point, or at a site of a line; of all, without one."""
        std = self.known.std[self.known.standing == standing]
        return float(np.median(std if len(std) else self.known.std))

    def proposal(self, contrast: float, node: int, end: tuple[float, float] | None = None) -> Proposal:
        """Return a node as a proposal."""
        height, spread, suspicion = (float(values[node]) for values in self.expectation(contrast))
        x, y = self.field.nodes[node, :2].tolist()
        return Proposal(place=(x, y), contrast=float(np.expm1(height)), std=spread, suspicion=suspicion, end=end)


def _nodes(place: Floats) -> Floats:
    """Return nodes (m, 2) [m] of a grid over places (n, 2) [m], a millimetre apart where they are not too many."""
    axes = []
    for low, high in zip(place.min(axis=0), place.max(axis=0), strict=True):
        count = int((high - low) / _NODE_DISTANCE) + 1
        axes.append(np.linspace(low, high, max(min(count, _MAX_NODES), 1)))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def passes(sites: Sites, places: Floats, within: float) -> NDArray[np.intp]:
    """Return how often (m,) the tip was nearer than a distance [m] to places (m, k), by points and line passes."""
    close = distances(places, sites.place) < within
    # A pass begins where the site before was not close; each point palpation is one of its own.
    again = close[:, 1:] & (~close[:, :-1] | sites.standing[1:])
    return np.asarray(again.sum(axis=1) + close[:, 0])
