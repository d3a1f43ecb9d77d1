"""A search of an area from round to round: what is known, where to go next, and when to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_maps.clearance import Clearance
from palpate_maps.hidden_patches import Hiding, Patch, hidden_patches
from palpate_maps.lumps import find_lumps
from palpate_maps.next_places import Aim, Knowledge, Proposal, near, propose
from palpate_maps.search_area import Area
from palpate_maps.search_motion import SearchMotion
from palpate_maps.search_progress import SUSPICIOUS, LumpProgress, footprint, off_limits, update_progress
from palpate_maps.sites import Sites, merge_sites

_APART = 4e-3  # [m] between places
_WIDTH = 4e-3  # [m] of a sweep's site
_SURELY = 20.0  # expected patches about a place, that is the odds that one is there, which make one known
_CHECKS = 2  # points about it


@dataclass(frozen=True)
class SearchSettings:
    """What is searched for, and how."""

    aim: Aim = "find"
    points: int = 3  # in one round
    contrast: float = 0.05  # that counts as a lump
    radius: float = 5e-3  # [m] at half its height, of the least patch that must not be missed
    risk: float | None = None  # probability that one remains, at which a search stops; None: it does not count
    sure: float = 0.001  # p-value below which a lump is certain

    def __post_init__(self) -> None:
        """Raise ConfigurationError for what cannot be searched for."""
        if self.risk is not None and not 0 < self.risk < 1:
            raise ConfigurationError(f"--risk: {self.risk:g} is not a probability between 0 and 1, such as 0.05")
        if not 0 < self.contrast < 100:
            raise ConfigurationError(f"--contrast: {self.contrast:g} must be above 0, such as 0.05")
        if not 0 < self.radius < 1:
            raise ConfigurationError(f"--radius: {1e3 * self.radius:g} mm must be above 0")

    @property
    def patch(self) -> Patch:
        """The least patch that must not be missed."""
        return Patch(self.radius, self.contrast)


@dataclass
class AreaSearch:
    """A search of an area with the motions of a rig."""

    area: Area
    motion: SearchMotion
    settings: SearchSettings
    lumps: list[LumpProgress] = field(default_factory=list)
    patches: list[tuple[float, float]] = field(default_factory=list)  # [m] that are likely, and no lump by its p-value
    hiding: Hiding | None = None
    _knowledge: Knowledge | None = None
    _std: float = 0.01

    @cached_property
    def middles(self) -> Floats:
        """Places (m, 2) [m] of the area, 0.6 of a patch's radius apart, at which a patch may hide."""
        nodes = self.area.nodes
        kept = np.ones(len(nodes), bool)
        for axis in (0, 1):
            values = np.unique(np.round(nodes[:, axis], 7))
            step = float(np.diff(values).min()) if len(values) > 1 else 1.0
            stride = max(int(0.6 * self.settings.radius / step + 1e-6), 1)
            begin = (len(values) - 1) % stride // 2
            kept &= np.isin(np.round(nodes[:, axis], 7), values[begin::stride])
        return nodes[kept]

    def observe(self, sites: Sites, visited: bool) -> None:
        """Take up all sites of the run so far; `visited` where the latest came of a round of this search."""
        if visited:
            self.lumps = update_progress(find_lumps(sites), self.lumps, sites, self.area, self.settings.sure)
        self._knowledge = Knowledge.of(sites, self.area.nodes, self._knowledge)
        coarse = merge_sites(sites, _WIDTH)
        visited_places = coarse.place[coarse.standing]
        self.patches = []
        while True:
            covered, on_lumps = (self._on_lumps(places) for places in (coarse.place, self.middles))
            self.hiding = hidden_patches(coarse[~covered], self.middles, self.settings.patch, on_lumps)
            place, number = self.hiding.likely
            checks = np.count_nonzero(np.hypot(*(visited_places - place).T) <= self.settings.radius)
            if number < _SURELY or checks < _CHECKS:
                break
            self.patches.append((float(place[0]), float(place[1])))
        self._std = self.hiding.scatter * float(np.median(sites.std))

    def _on_lumps(self, places: Floats) -> NDArray[np.bool_]:
        found = np.zeros(len(places), bool)
        for item in self.lumps:
            found |= footprint(places, item.lump, self.settings.contrast, _APART)
        return found | near(places, np.array(self.patches).reshape(-1, 2), 2 * self.settings.radius)

    def next_round(self) -> list[Proposal]:
        """Where to go next: up to so many points, or one line; nothing where every place is known."""
        assert self._knowledge is not None
        assert self.hiding is not None
        settings, known = self.settings, self._knowledge
        done = off_limits(known.field.nodes, self.lumps, settings.contrast, _APART)
        taken = done if settings.aim == "find" else None
        places = propose(known, settings.points, settings.aim, settings.contrast, _APART, taken, self.motion.seconds_to)
        if settings.aim != "find" or settings.risk is None or any(p.suspicion >= SUSPICIOUS for p in places):
            return places
        return self._clearing() if self.hiding.risk > settings.risk else places

    def _clearing(self) -> list[Proposal]:
        """The line, or the points, that leave the fewest patches to hide."""
        hiding, known, std = self.hiding, self._knowledge, self._std
        assert hiding is not None
        assert known is not None
        chosen: list[Proposal] = []
        expected = hiding.expected
        visited = known.known.place[known.known.standing]
        closed = self._on_lumps(self.middles) | near(self.middles, visited, _APART / 2)
        for _ in range(self.settings.points):
            action = self._clearance.best(expected, std, closed)
            if action is None or (chosen and action.end is not None):
                break
            node = int(np.argmin(((known.field.nodes - self.middles[action.start]) ** 2).sum(axis=1)))
            end = None if action.end is None else tuple(self.middles[action.end].tolist())
            chosen.append(known.proposal(self.settings.contrast, node, end))
            if end is not None:
                break
            expected = self._clearance.after(expected, action.start, std)
            closed[action.start] = True
        return chosen

    @cached_property
    def _clearance(self) -> Clearance:
        return Clearance(self.middles, self.settings.patch, self.motion)

    def ended(self, places: Sequence[Proposal]) -> str | None:
        """Why the search is over, where it is: every lump certain, no place suspicious, and the risk as low as asked.

        Without a risk it goes on until there is a lump; an outline or a map never ends by itself.
        """
        settings, hiding = self.settings, self.hiding
        over = (item.done if settings.risk is None else item.certain for item in self.lumps)
        if settings.aim != "find" or not all(over):
            return None
        if any(p.suspicion >= SUSPICIOUS for p in places) or (settings.risk is None and not self.lumps):
            return None
        if settings.risk is not None and (hiding is None or hiding.risk > settings.risk):
            return None
        which = "there is no lump" if not self.lumps else f"every lump is certain at {settings.sure:g}"
        return f"{which}, and nothing else is suspicious"
