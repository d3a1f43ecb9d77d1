"""A search of an area from round to round: what is known, where to go next, and when to stop."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_maps.clearance import Clearance, PatchGrid
from palpate_maps.field_gain import FieldGain
from palpate_maps.grid_cells import Cells, grid_steps, thinned
from palpate_maps.hidden_patches import REACH, Hiding, Patch, hidden_patches
from palpate_maps.lumps import FEWEST, find_lumps
from palpate_maps.next_places import Aim, Knowledge, Proposal, passes
from palpate_maps.search_actions import ActionGrid, Gain, SearchAction
from palpate_maps.search_area import Area
from palpate_maps.search_motion import SearchMotion
from palpate_maps.search_progress import CHECKS, SUSPICIOUS, LumpProgress, footprint, update_progress
from palpate_maps.sites import Sites, line_coordinate, merge_sites
from palpate_maps.stiffness_field import near
from palpate_maps.surface_map import arc_warning

_APART = 4e-3  # [m] between places
_ABOUT = 12e-3  # [m] about the highest place of a lump that has to be known, for its middle to be
_WIDTH = 4e-3  # [m] of a sweep's site
_RISK = 0.05  # that a search goes towards where none is given
_UNLIKELY = 0.3  # risk below which lumps are outlined before more of them are looked for
_OUTLINED = 0.9  # intersection over union of a lump's outline that is good enough
_SURELY = 20.0  # expected patches about a place, that is the odds that one is there, which make one known


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
        if not 0 < self.sure < 1:
            raise ConfigurationError(f"--sure: {self.sure:g} is not a p-value between 0 and 1, such as 0.001")
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
    _visited: bool = False
    _std: float = 0.01
    _visits: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # places (n, k) [m] at which the tip was
    _doubtful: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # places (n, k) [m] to go through

    def __post_init__(self) -> None:
        """Raise ConfigurationError where the area's surface is too sharp for the least patch."""
        if self.area.skin is not None:
            self.area.skin.demand_gentle(self.settings.radius, self.area.nodes)

    @property
    def warning(self) -> str | None:
        """What a surface does that is curved on the scale of the field's interpolation; None where it is not."""
        if self.area.skin is None or self._knowledge is None:
            return None
        return arc_warning(self._knowledge.field.kernel.length, self.area.skin.reach)

    @cached_property
    def _rows(self) -> NDArray[np.intp]:
        """Of the area's nodes those of a grid 0.6 of a patch's radius apart, also where a surface is steepest."""
        stretch = 1.0 if self.area.skin is None else float(self.area.skin.stretch.max())
        apart = 0.6 * self.settings.radius / stretch
        strides = apart / grid_steps(self.area.nodes, self.area.cells) + 1e-6
        return thinned(self.area.cells, (max(int(strides[0]), 1), max(int(strides[1]), 1)))

    @cached_property
    def middles(self) -> Floats:
        """Places (m, k) [m] at which a patch may hide, and from and to which the tip goes."""
        return self.area.nodes[self._rows]

    @property
    def cells(self) -> Cells:
        """(m, 2) column and row of each of the middles in the area's grid."""
        return self.area.cells[self._rows]

    def observe(self, sites: Sites, visited: bool) -> None:
        """Take up all sites of the run so far; `visited` where the latest came of a round of this search.

        A single line has no lumps before the first round, which goes off it.
        """
        flat, sites = sites, replace(sites, place=self.area.lift(sites.place))
        if visited or (line_coordinate(sites) is None and len(sites) >= FEWEST):
            before = self.lumps if self._visited else []
            lumps = find_lumps(sites if line_coordinate(sites) is None or sites.standing.all() else flat)
            self.lumps = update_progress(lumps, before, sites, self.area, self.settings.sure)
        self._visited = visited
        self._knowledge = Knowledge.of(sites, self.area.nodes, self._knowledge)
        coarse = merge_sites(sites, _WIDTH)
        self._visits = coarse.place
        self.patches = []
        while True:
            covered, on_lumps = (self._on_lumps(places) for places in (coarse.place, self.middles))
            self.hiding = hidden_patches(
                coarse[~covered], self.middles, self.settings.patch, on_lumps, self.hiding, self._extent
            )
            place, number = self.hiding.likely
            if number < _SURELY or passes(coarse, place[None], self.settings.radius)[0] < CHECKS:
                break
            self.patches.append((float(place[0]), float(place[1])))
        self._std = self.hiding.scatter * float(np.median(sites.std))
        self._doubtful = self._doubtful_places(self._knowledge)

    def _on_lumps(self, places: Floats) -> NDArray[np.bool_]:
        """(n,) which places (n, k) [m] are on a known lump or a likely patch, and not far from every visit."""
        found = np.zeros(len(places), bool)
        for item in self.lumps:
            found |= footprint(places, item.lump, self.settings.contrast, _APART)
        patches = self.area.lift(np.array(self.patches).reshape(-1, 2))
        found |= near(places, patches, 2 * self.settings.radius)
        return found & near(places, self._visits, REACH * self.settings.radius)

    def next_round(self) -> list[Proposal]:
        """Where to go next: up to so many points, or one line; nothing where every place is known."""
        known = self._knowledge
        assert known is not None
        closed = near(self.middles, known.known.place[known.known.standing], _APART / 2)
        through = np.ones(len(self.middles), bool)
        if self.settings.aim == "map":
            gain: Gain = FieldGain.of(known, self._rows, known.field.std**2)
        elif len(self._doubtful):
            gain = FieldGain.of(known, self._rows, self._unclear(known, self._doubtful))
            through = near(self.middles, self._doubtful, 0.6 * self.settings.radius)
            if self.motion.line_speed is None and not (through & ~closed).any():
                through = near(self.middles, self._doubtful, _ABOUT)
        elif self.settings.aim == "outline" and self._is_outlining(known):
            gain = FieldGain.of(known, self._rows, self._unclear(known, self._tops))
        else:
            assert self.hiding is not None
            gain = Clearance.of(self._patches_grid, self.hiding.expected, self._allowed, self._std)
            closed = closed | self._on_lumps(self.middles)
        actions = self._grid.next_round(gain, self.settings.points, known.known.place[-1], closed, through)
        proposals = [self._proposal(known, action) for action in actions]
        alone = self.area.skin is not None and len(proposals) > 1 and not self.motion.can_go(proposals)
        return proposals[:1] if alone else proposals

    @property
    def _allowed(self) -> float:
        """Risk that a search goes towards."""
        return _RISK if self.settings.risk is None else self.settings.risk

    @property
    def _tops(self) -> Floats:
        """Highest places (n, k) [m] of all lumps."""
        lumps = [item.lump for item in self.lumps]
        return self.area.lift(np.array([lump.highest or lump.place for lump in lumps]).reshape(-1, 2))

    def _doubtful_places(self, known: Knowledge) -> Floats:
        """Places (n, k) [m] to go through: lumps that are not certain, and likely ones that were not checked."""
        nodes = known.field.nodes
        unsure = np.array([not self._over(item) for item in self.lumps], bool)
        if unsure.any():
            return np.asarray(self._tops[unsure])
        _, _, above = known.expectation(self.settings.contrast)
        likely = np.flatnonzero((above >= SUSPICIOUS) & ~self._on_lumps(nodes))
        return nodes[likely[passes(known.known, nodes[likely], _APART) < CHECKS]]

    def _unclear(self, known: Knowledge, places: Floats) -> Floats:
        """(m,) how uncertain it is that the field's nodes about some places (n, k) [m] are above the contrast."""
        _, _, above = known.expectation(self.settings.contrast)
        return np.asarray(np.where(near(known.field.nodes, places, _ABOUT), above * (1 - above), 0.0))

    def _is_outlining(self, known: Knowledge) -> bool:
        """Whether the lumps are to be outlined next, and not more of them to be looked for.

        That is while more of them are unlikely and the intersection over union that is expected of their outline is
        below 0.9, and once a search for more would end.
        """
        assert self.hiding is not None
        above = known.expectation(self.settings.contrast)[2][near(known.field.nodes, self._tops, _ABOUT)]
        seen = above > 0.5
        both, either = float(above[seen].sum()), float(np.count_nonzero(seen) + above[~seen].sum())
        rough = both < _OUTLINED * either and self.hiding.risk <= _UNLIKELY
        return bool(self.lumps) and (rough or self.hiding.risk <= self._allowed)

    def _proposal(self, known: Knowledge, action: SearchAction) -> Proposal:
        end = None if action.end is None else tuple(self.middles[action.end, :2].tolist())
        return known.proposal(self.settings.contrast, int(self._rows[action.start]), end)

    def _over(self, item: LumpProgress) -> bool:
        """Whether a lump is known well enough: by itself also beyond the border of what was palpated."""
        alone = self.settings.risk is None and self.settings.aim == "find"
        return item.done if alone else item.certain

    @cached_property
    def _grid(self) -> ActionGrid:
        skin = self.area.skin
        return ActionGrid(self.middles, self.cells, self.motion, None if skin is None else skin.normal[self._rows])

    @cached_property
    def _extent(self) -> Floats | None:
        """(m,) area of the skin about each of the middles, relative; None where they are alike."""
        return None if self.area.skin is None else self.area.skin.stretch[self._rows]

    @cached_property
    def _patches_grid(self) -> PatchGrid:
        return PatchGrid(self.middles, self.settings.patch)

    def ended(self) -> str | None:
        """Why the search is over, where it is: every lump certain, no place suspicious, and the risk as low as asked.

        Without a risk it goes on until there is a lump; an outline or a map never ends by itself.
        """
        settings, hiding = self.settings, self.hiding
        if settings.aim != "find" or len(self._doubtful):
            return None
        if not self.lumps if settings.risk is None else (hiding is None or hiding.risk > settings.risk):
            return None
        which = "no lump" if not self.lumps else f"every lump is certain at {settings.sure:g}"
        return f"{which}, and nothing else is suspicious"
