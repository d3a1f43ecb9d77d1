"""Where to look next: proposals from a map, and when to stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_maps.baseline_sites import find_baseline
from palpate_maps.lump_criteria import Lump
from palpate_maps.map_grid import gaussian_process
from palpate_maps.sites import Sites, merge_sites

Aim = Literal["suspicion", "uncertainty"]

SETTLED = 4e-3  # [m]: the width of a site
_LIKELY = 0.5  # suspicion beyond which it is no reason to prefer a place


@dataclass(frozen=True)
class Proposal:
    """A place to palpate next, and why."""

    place: tuple[float, float]  # [m]
    contrast: float  # expected there, over the baseline
    std: float  # of it
    suspicion: float  # probability of a contrast above the threshold


def is_placed(before: Lump | None, now: Lump | None, sure: float, within: float = SETTLED) -> bool:
    """Whether a lump is placed: its p-value is below `sure`, and a round of visits has not moved it [m].

    A point on the flank of a lump is significant, too; the lump is placed once another round of visits leaves it there.
    """
    if before is None or now is None or now.p >= sure:
        return False
    return float(np.hypot(now.place[0] - before.place[0], now.place[1] - before.place[1])) < within


def propose(
    sites: Sites,
    count: int = 5,
    aim: Aim = "suspicion",
    contrast: float = 0.05,
    nodes: Floats | None = None,
    apart: float = 4e-3,
    taken: NDArray[np.bool_] | None = None,
) -> list[Proposal]:
    """Up to `count` places to palpate next, of `nodes` (m, 2) [m] that may be visited, `apart` [m] from each other.

    A Gaussian process over what is known gives a mean and a standard deviation everywhere; places are taken one after
    the other. "suspicion": by the highest probability of a contrast above the threshold, and of the likely ones by the
    highest mean plus standard deviation. "uncertainty": by the highest standard deviation. Each place is assumed to
    come out as expected before the next is chosen (kriging believer, Ginsbourger et al. 2010). Nodes that are `taken`
    (m,) are left out; without nodes they are those of the box of the sites. Deterministic.
    """
    if count < 1:
        raise ConfigurationError(f"{count} places to propose; there must be at least 1")
    from scipy.stats import norm

    known = merge_sites(sites, 3e-3)
    base = find_baseline(known.log, floor=0.005)
    nodes = _nodes(known.place) if nodes is None else nodes
    closed = np.zeros(len(nodes), bool) if taken is None else taken
    visited = known.place[known.standing] if aim == "suspicion" else np.zeros((0, 2))
    closed = closed | _near(nodes, visited, apart)
    found: list[Proposal] = []
    for _ in range(count):
        mean, std, _ = gaussian_process(known, nodes, base.mean)
        spread = np.hypot(std, base.spread / np.sqrt(base.count))
        suspicion = norm.sf((base.mean + np.log1p(contrast) - mean) / spread)
        # Of likely places, the one that may be stiffest: a flank that is certain says less than what is beside it.
        may_be = mean - base.mean + std
        score = std if aim == "uncertainty" else np.minimum(suspicion, _LIKELY) + 1e-3 * may_be
        score = np.where(closed, -np.inf, score)
        best = int(np.argmax(score))
        if not np.isfinite(score[best]):
            break
        x, y = (float(value) for value in nodes[best])
        found.append(
            Proposal((x, y), float(np.expm1(mean[best] - base.mean)), float(spread[best]), float(suspicion[best]))
        )
        known = _with(known, nodes[best], float(mean[best]))
        closed = closed | _near(nodes, nodes[best : best + 1], apart)
    return found


def _nodes(place: Floats) -> Floats:
    low, high = place.min(axis=0), place.max(axis=0)
    x, y = (np.linspace(a, b, max(min(int((b - a) / 1e-3) + 1, 60), 1)) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _near(nodes: Floats, places: Floats, apart: float) -> NDArray[np.bool_]:
    near = np.zeros(len(nodes), bool)
    for place in places:
        near |= np.hypot(*(nodes - place).T) < apart
    return near


def _with(sites: Sites, place: Floats, log: float) -> Sites:
    """Sites and one more, assumed to be as expected."""
    return Sites(
        np.vstack([sites.place, place]),
        np.append(sites.log, log),
        np.append(sites.std, 0.005),
        np.append(sites.time, sites.time[-1] + 1.0),
        np.append(sites.standing, False),
        sites.kept,
        sites.relief,
    )
