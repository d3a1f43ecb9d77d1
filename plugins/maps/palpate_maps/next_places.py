"""Where to look next: proposals from what is known of an area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_maps.baseline_sites import Baseline, find_baseline
from palpate_maps.lump_criteria import Lump
from palpate_maps.sites import Sites, merge_sites
from palpate_maps.stiffness_field import StiffnessField

Aim = Literal["find", "outline", "map"]

SETTLED = 4e-3  # [m]: the width of a site
_SITE = 3e-3  # [m] of a sweep that is one observation of the field
_LIKELY = 0.5  # suspicion beyond which it is no reason to prefer a place
_EXPECTED_STD = 0.005  # of the logarithm of a place that is assumed to come out as expected
_CANDIDATES = 64  # places whose effect on all others is computed
_NODES = 1600  # places that the effect is summed over


@dataclass(frozen=True)
class Proposal:
    """A place to palpate next, or a line from there to its end, and why."""

    place: tuple[float, float]  # [m]
    contrast: float  # expected there, over the baseline; on a line, where that is largest
    std: float  # of it
    suspicion: float  # probability of a contrast above the threshold
    end: tuple[float, float] | None = None  # [m] of a line


def is_placed(before: Lump | None, now: Lump | None, sure: float, within: float = SETTLED) -> bool:
    """Whether a lump is placed: its p-value is below `sure`, and a round of visits has not moved it [m].

    A point on the flank of a lump is significant, too; the lump is placed once another round of visits leaves it there.
    """
    if before is None or now is None or now.p >= sure:
        return False
    return float(np.hypot(now.place[0] - before.place[0], now.place[1] - before.place[1])) < within


@dataclass
class Knowledge:
    """What a search knows of an area: the sites, their baseline, and the field over the places that may be visited."""

    known: Sites
    base: Baseline
    field: StiffnessField

    @classmethod
    def of(cls, sites: Sites, nodes: Floats | None = None, before: Knowledge | None = None) -> Knowledge:
        """From the sites of a path; `before` is what was known before the latest of them."""
        known = merge_sites(sites, _SITE)
        base = find_baseline(known.log, floor=0.005)
        if before is not None:
            return cls(known, base, before.field.update(known, base.mean))
        nodes = _nodes(known.place) if nodes is None else nodes
        return cls(known, base, StiffnessField.of(known, nodes, base.mean))

    def expectation(self, contrast: float) -> tuple[Floats, Floats, Floats]:
        """(m,) each: mean and standard deviation of the height over the baseline, probability of a contrast above."""
        from scipy.special import ndtr

        height = self.field.mean(self.base.mean) - self.base.mean
        spread = np.hypot(self.field.std, self.base.spread / np.sqrt(self.base.count))
        return height, spread, ndtr((height - np.log1p(contrast)) / spread)

    def proposal(self, contrast: float, node: int, end: tuple[float, float] | None = None) -> Proposal:
        """A node as a proposal."""
        height, spread, suspicion = (float(values[node]) for values in self.expectation(contrast))
        x, y = self.field.nodes[node].tolist()
        return Proposal((x, y), float(np.expm1(height)), spread, suspicion, end)


def propose(
    knowledge: Knowledge,
    count: int = 5,
    aim: Aim = "find",
    contrast: float = 0.05,
    apart: float = 4e-3,
    taken: NDArray[np.bool_] | None = None,
    seconds: Callable[[Floats], Floats] | None = None,
) -> list[Proposal]:
    """Up to `count` places to palpate next, `apart` [m] from each other; nodes that are `taken` (m,) are left out.

    A Gaussian process over what is known gives a mean and a standard deviation everywhere; places are taken one after
    the other, by their worth per second, where `seconds` [s] are those of the motion by the distance from the place
    before. "find": by the highest probability of a contrast above the threshold, and of the likely ones by the highest
    mean plus standard deviation. "outline": by how much less uncertain it becomes which places are above the threshold,
    sum_j p_j (1 - p_j) rho^2 with the correlation rho of place and palpation. "map": by the variance that is left, over
    all places. Each place is assumed to come out as expected before the next is chosen (kriging believer, Ginsbourger
    et al. 2010). Deterministic.
    """
    if count < 1:
        raise ConfigurationError(f"{count} places to propose; there must be at least 1")
    field, known, base = knowledge.field, knowledge.known, knowledge.base
    nodes = field.nodes
    closed = np.zeros(len(nodes), bool) if taken is None else taken
    if aim == "find":
        closed = closed | near(nodes, known.place[known.standing], apart)
    found: list[Proposal] = []
    for _ in range(count):
        score = _find_score(knowledge, contrast) if aim == "find" else _gain(knowledge, aim, contrast, closed)
        if seconds is not None and found:
            score = score / seconds(np.hypot(*(nodes - np.array(found[-1].place)).T))
        score = np.where(closed, -np.inf, score)
        best = int(np.argmax(score))
        if not np.isfinite(score[best]):
            break
        found.append(knowledge.proposal(contrast, best))
        expected = float(field.mean(base.mean)[best])
        field.add(nodes[best], expected, _EXPECTED_STD**2, base.mean)
        closed = closed | near(nodes, nodes[best : best + 1], apart)
    field.drop(len(found))
    return found


def _find_score(knowledge: Knowledge, contrast: float) -> Floats:
    height, _, suspicion = knowledge.expectation(contrast)
    # Of likely places, the one that may be stiffest: a flank that is certain says less than what is beside it.
    may_be = height + knowledge.field.std
    return np.asarray(np.minimum(suspicion, _LIKELY) + 1e-3 * may_be)


def _gain(knowledge: Knowledge, aim: Aim, contrast: float, closed: NDArray[np.bool_]) -> Floats:
    """(m,) what a palpation of each node would gain; -inf but for the candidates."""
    field, std = knowledge.field, knowledge.field.std
    _, _, above = knowledge.expectation(contrast)
    weight = above * (1 - above) if aim == "outline" else std**2
    order = np.argsort(-np.where(closed, -np.inf, weight), kind="stable")
    chosen = (
        order[: _CANDIDATES * 16 : 16] if len(order) > 16 * _CANDIDATES else order[:: 1 + len(order) // _CANDIDATES]
    )
    counted = np.arange(0, len(std), 1 + len(std) // _NODES)
    if aim == "outline":  # what is certain has no weight
        counted = np.argsort(-weight, kind="stable")[:_NODES]
    noisy = std[chosen] ** 2 + field.kernel.noise + _EXPECTED_STD**2
    shared = field.covariance(chosen, counted) ** 2 / noisy[:, None]
    score = np.full(len(std), -np.inf)
    score[chosen] = shared @ (weight[counted] / std[counted] ** 2)
    return score


def _nodes(place: Floats) -> Floats:
    low, high = place.min(axis=0), place.max(axis=0)
    x, y = (np.linspace(a, b, max(min(int((b - a) / 1e-3) + 1, 60), 1)) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def near(nodes: Floats, places: Floats, apart: float) -> NDArray[np.bool_]:
    """(m,) which nodes [m] are nearer than `apart` [m] to any of some places (n, 2) [m]."""
    from scipy.spatial import KDTree

    if not len(places):
        return np.zeros(len(nodes), bool)
    distance, _ = KDTree(places).query(nodes, distance_upper_bound=apart)
    return np.asarray(distance < apart)
