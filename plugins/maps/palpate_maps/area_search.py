"""A search of an area from round to round: its knowledge, the next places, and the end."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

from palpate_maps.body_field import rise
from palpate_maps.clearance import Clearance, PatchGrid
from palpate_maps.field_gain import FieldGain
from palpate_maps.grid_cells import Cells, grid_steps, thinned
from palpate_maps.hidden_patches import REACH, Hiding, Patch, hidden_patches
from palpate_maps.lump_criteria import MIN_SITES
from palpate_maps.lumps import find_lumps
from palpate_maps.next_places import Aim, Knowledge, Proposal, passes
from palpate_maps.search_actions import ActionGrid, Gain, SearchAction
from palpate_maps.search_area import Area
from palpate_maps.search_motion import SearchMotion
from palpate_maps.search_progress import CHECKS, SUSPICIOUS, LumpProgress, footprint, update_progress
from palpate_maps.sites import Sites, line_coordinate, merge_sites
from palpate_maps.stiffness_field import distances, near
from palpate_maps.surface_map import arc_warning

_SITE_WIDTH = 4e-3  # [m] of a sweep's site, and between places: that of `LumpSettings`
# Of decisions 0280 and 0281.
_ABOUT_LUMP = 12e-3  # [m] about the highest place of a lump that has to be known, for its middle to be
_NODE_RADII = 0.6  # of the least patch, between nodes
_UNLIKELY = 0.3  # risk below which lumps are outlined before more of them are looked for
_OUTLINED = 0.9  # intersection over union of a lump's outline that is good enough
_KNOWN_ODDS = 20.0  # expected patches about a place, that is the odds that one is there, which make one known
# Choices.
_RISK = 0.05  # that a search goes towards where none is given
_START_STD = 0.01  # of a palpation's logarithm, until the first sites are known
_ROUNDING = 1e-6  # steps of the area's grid


@dataclass(frozen=True)
class SearchSettings:
    """The aim of a search, the least patch that it is for, and its limits."""

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
    _std: float = _START_STD
    _visits: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # places (n, k) [m] at which the tip was
    _doubtful: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # places (n, k) [m] to go through

    def __post_init__(self) -> None:
        """Raise ConfigurationError where the area's surface is too sharp for the least patch."""
        if self.area.skin is not None:
            self.area.skin.demand_gentle(self.settings.radius, self.area.nodes)

    @property
    def warning(self) -> str | None:
        """The effect of a surface that is curved on the scale of the field's interpolation; None where it is not."""
        if self.area.skin is None or self._knowledge is None:
            return None
        return arc_warning(self._knowledge.field.kernel.length, self.area.skin.reach)

    @cached_property
    def _rows(self) -> NDArray[np.intp]:
        """Of the area's nodes those of a grid 0.6 of a patch's radius apart, also where a surface is steepest."""
        stretch = 1.0 if self.area.skin is None else float(self.area.skin.stretch.max())
        distance = self._node_distance / stretch
        strides = distance / grid_steps(self.area.nodes, self.area.cells) + _ROUNDING
        return thinned(self.area.cells, (max(int(strides[0]), 1), max(int(strides[1]), 1)))

    @property
    def _node_distance(self) -> float:
        """Distance [m] of neighbouring nodes along the skin."""
        return _NODE_RADII * self.settings.radius

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
        lifted = replace(sites, place=self.area.lift(sites.place))
        self._observe_lumps(sites, lifted, visited)
        self._knowledge = Knowledge.of(lifted, self.area.nodes, self._knowledge)
        self.hiding = self._remainder(merge_sites(lifted, _SITE_WIDTH))
        self._std = self.hiding.scatter * float(np.median(sites.std))
        self._doubtful = self._doubtful_places(self._knowledge)

    def _observe_lumps(self, flat: Sites, lifted: Sites, visited: bool) -> None:
        """Find the lumps of sites, and their progress since the round before; of a line as in the plane."""
        off_line = line_coordinate(lifted) is None
        if visited or (off_line and len(lifted) >= MIN_SITES):
            before = self.lumps if self._visited else []
            findings = find_lumps(lifted if off_line or lifted.standing.all() else flat)
            self.lumps = update_progress(findings, before, lifted, self.area, self.settings.sure)
        self._visited = visited

    def _remainder(self, sites: Sites) -> Hiding:
        """Return the patches that remain apart from known lumps and likely patches, which it takes up one by one.

        The sites are taken without the rise by the bodies of known lumps, whose flanks are not patches. A patch that
        two points or passes have checked is known by its odds, though no p-value calls it a lump.
        """
        self._visits = sites.place
        bodies = [body for item in self.lumps for body in item.lump.bodies]
        sites = replace(sites, log=sites.log - rise(bodies, sites.place)[0])
        self.patches = []
        while True:
            covered, on_lumps = self._on_lumps(sites.place), self._on_lumps(self.middles)
            hiding = hidden_patches(
                sites=sites[~covered],
                middles=self.middles,
                patch=self.settings.patch,
                on_lumps=on_lumps,
                before=self.hiding,
                extent=self._extent,
            )
            self.hiding = hiding
            place, number = hiding.likely  # the likeliest place, and the patches that are expected about it
            if number < _KNOWN_ODDS or passes(sites, place[None], self.settings.radius)[0] < CHECKS:
                return hiding
            self.patches.append((float(place[0]), float(place[1])))

    def _on_lumps(self, places: Floats) -> NDArray[np.bool_]:
        """Return True (n,) for places (n, k) [m] on a known lump or a likely patch, and not far from every visit."""
        covered = np.zeros(len(places), bool)
        for item in self.lumps:
            covered |= footprint(places, item.lump, self.settings.contrast, _SITE_WIDTH)
        patches = self.area.lift(np.array(self.patches).reshape(-1, 2))
        covered |= near(places, patches, REACH * self.settings.radius)
        return covered & near(places, self._visits, REACH * self.settings.radius)

    def next_round(self) -> list[Proposal]:
        """Return the next places: up to so many points, or one line; none where every place is known."""
        knowledge = self._knowledge
        assert knowledge is not None
        sites = knowledge.known
        # No point is palpated again, and none of those that may hide a patch is on a known lump.
        closed = near(self.middles, sites.place[sites.standing], _SITE_WIDTH / 2)
        gain, clears = self._gain(knowledge)  # `clears`: it is the gain of showing that no patch is hidden
        if clears:
            closed = closed | self._on_lumps(self.middles)
        through = self._through(closed)
        actions = self._grid.next_round(gain, self.settings.points, sites.place[-1], closed, through)
        proposals = [self._proposal(knowledge, action) for action in actions]
        # Points with an unknown surface between them are visited one by one.
        if self.area.skin is not None and len(proposals) > 1 and not self.motion.can_go(proposals):
            return proposals[:1]
        return proposals

    def _gain(self, knowledge: Knowledge) -> tuple[Gain, bool]:
        """Return the gain of the next palpations, and True where it is the clearance of the area.

        A map gains by its variance; a search first by what is doubtful, then by its outlines, then by what may hide.
        """
        if self.settings.aim == "map":
            return FieldGain.of(knowledge, self._rows, knowledge.field.std**2), False
        if len(self._doubtful):
            return FieldGain.of(knowledge, self._rows, self._unclear(knowledge, self._doubtful)), False
        if self.settings.aim == "outline" and self._is_outlining(knowledge):
            return FieldGain.of(knowledge, self._rows, self._unclear(knowledge, self._tops)), False
        assert self.hiding is not None
        return Clearance.of(self._patches_grid, self.hiding.expected, self._allowed, self._std), True

    def _through(self, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the middles (m,) that a line has to go through, or a point be at: those that are doubtful, or all."""
        if self.settings.aim == "map" or not len(self._doubtful):
            return np.ones(len(self.middles), bool)
        through = near(self.middles, self._doubtful, self._node_distance)
        # By points alone, where all of these were palpated: those about them.
        if self.motion.line_speed is None and not (through & ~closed).any():
            return near(self.middles, self._doubtful, _ABOUT_LUMP)
        return through

    @property
    def _allowed(self) -> float:
        """Risk that a search goes towards."""
        return _RISK if self.settings.risk is None else self.settings.risk

    @property
    def _tops(self) -> Floats:
        """Highest places (n, k) [m] of all lumps; of one whose middle lies outside of the area, the nearest in it."""
        lumps = [item.lump for item in self.lumps]
        tops = self.area.lift(np.array([lump.highest or lump.place for lump in lumps]).reshape(-1, 2))
        apart = distances(tops, self.area.nodes)
        is_outside = apart.min(axis=1, initial=np.inf) > self._node_distance
        return np.where(is_outside[:, None], self.area.nodes[np.argmin(apart, axis=1)], tops)

    def _doubtful_places(self, knowledge: Knowledge) -> Floats:
        """Return places (n, k) [m] to go through: lumps that are not certain, and likely ones that were not checked."""
        nodes = knowledge.field.nodes
        # Lumps come before places that only may be one.
        unsure = np.array([not self._is_known(item) for item in self.lumps], bool)
        if unsure.any():
            return np.asarray(self._tops[unsure])
        _, _, above = knowledge.expectation(self.settings.contrast)
        likely = np.flatnonzero((above >= SUSPICIOUS) & ~self._on_lumps(nodes))
        return nodes[likely[passes(knowledge.known, nodes[likely], _SITE_WIDTH) < CHECKS]]

    def _unclear(self, knowledge: Knowledge, places: Floats) -> Floats:
        """Return p (1 - p) (m,) of nodes about places (n, k) [m], p the probability of a contrast over the limit."""
        _, _, above = knowledge.expectation(self.settings.contrast)
        return np.asarray(np.where(near(knowledge.field.nodes, places, _ABOUT_LUMP), above * (1 - above), 0.0))

    def _is_outlining(self, knowledge: Knowledge) -> bool:
        """Return True if the lumps are to be outlined next, and not more of them to be looked for.

        That is while more of them are unlikely and the intersection over union that is expected of their outline is
        below 0.9, and once a search for more would end. The outline is where a contrast above is likelier than not.
        """
        assert self.hiding is not None
        if not self.lumps:
            return False
        # Probability of a contrast above the limit, at the nodes about the lumps.
        _, _, above = knowledge.expectation(self.settings.contrast)
        above = above[near(knowledge.field.nodes, self._tops, _ABOUT_LUMP)]
        inside = above > SUSPICIOUS
        intersection = float(above[inside].sum())
        union = float(np.count_nonzero(inside) + above[~inside].sum())
        is_rough = intersection < _OUTLINED * union and self.hiding.risk <= _UNLIKELY
        return is_rough or self.hiding.risk <= self._allowed

    def _proposal(self, knowledge: Knowledge, action: SearchAction) -> Proposal:
        end = None if action.end is None else tuple(self.middles[action.end, :2].tolist())
        return knowledge.proposal(self.settings.contrast, int(self._rows[action.start]), end)

    def _is_known(self, item: LumpProgress) -> bool:
        """Return True if a lump is known well enough: without a risk also beyond the border of what was palpated."""
        ends_with_lumps = self.settings.risk is None and self.settings.aim == "find"
        return item.done if ends_with_lumps else item.certain

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
        """Return the reason that the search is over: every lump certain, nothing suspicious, and the risk low enough.

        Without a risk it goes on until there is a lump; an outline or a map never ends by itself.
        """
        settings, hiding = self.settings, self.hiding
        if settings.aim != "find" or len(self._doubtful):
            return None
        if not self.lumps if settings.risk is None else (hiding is None or hiding.risk > settings.risk):
            return None
        which = "no lump" if not self.lumps else f"every lump is certain at {settings.sure:g}"
        return f"{which}, and nothing else is suspicious"
