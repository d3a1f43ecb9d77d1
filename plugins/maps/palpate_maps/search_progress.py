"""The progress of a search with each lump, from round to round, until nothing remains to be found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.body_field import FWHM
from palpate_maps.lump_criteria import Findings, Lump
from palpate_maps.next_places import SETTLED, is_placed, lumps_apart, passes
from palpate_maps.search_area import Area
from palpate_maps.sites import Sites, line_coordinate

CHECKS = 2  # points at a place, or lines across it, from which on it is checked (decision 0281)
SUSPICIOUS = 0.5  # probability of a contrast above the threshold that calls for a visit: as likely as not
_RING = (
    4e-3  # [m] around the stiffest place of a lump that has to be known, for its middle to be inside: a site's width
)
_DIRECTIONS = 8  # of that ring
_MIN_CONTRAST_RATIO = 1.5  # of a lump's contrast over the one down to which its flanks go, so that it has a footprint


@dataclass(frozen=True)
class LumpProgress:
    """One lump in a search."""

    lump: Lump
    certain: bool  # checked by a point or two lines, significant, and in place since the round before
    beyond: bool  # its stiffest place lies at the border of what was palpated, and more may be palpated there
    cut: bool  # its stiffest place lies at the border of what may be palpated

    @property
    def done(self) -> bool:
        """True where nothing more is to be learned of it here."""
        return self.certain and not self.beyond


def update_progress(
    findings: Findings, before: Sequence[LumpProgress], sites: Sites, area: Area, sure: float
) -> list[LumpProgress]:
    """Return every lump of a round with its progress: certain or not, and at which border; the surest first.

    It is certain once it was checked, its p-value is below `sure`, and it lies where the nearest lump of the round
    before did.
    """
    lumps_before = [item.lump for item in before]
    progress = []
    for lump in sorted(findings.lumps, key=attrgetter("p")):
        nearest = min(lumps_before, key=lambda other: lumps_apart(other, lump, area.lift), default=None)
        beyond, cut = borders(sites, lump, area)
        # Checked by a point of it, or by passes of its highest place.
        highest = area.lift(np.array([lump.highest or lump.place]))
        checked = lump.checked or passes(sites, highest, SETTLED)[0] >= CHECKS
        certain = checked and is_placed(nearest, lump, sure, area.lift)
        progress.append(LumpProgress(lump, certain, beyond=beyond, cut=cut))
    return progress


def borders(sites: Sites, lump: Lump, area: Area) -> tuple[bool, bool]:
    """Return True for each border at which a lump's stiffest place lies: of the sites, and of the area.

    The first is the border of what was palpated, where the area goes on; the second that of what may be palpated.
    """
    from scipy.spatial import ConvexHull

    # The stiffest site of the lump, and a ring about it.
    distance = np.linalg.norm(sites.place - area.lift(np.array([lump.place])), axis=1)
    rows = np.flatnonzero(distance <= max(*lump.extent, 2 * SETTLED, float(distance.min()) + SETTLED))
    lateral = sites.place[:, :2]
    peak = lateral[rows[int(np.argmax(sites.log[rows]))]]
    angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    ring = peak + _RING * np.column_stack([np.cos(angle), np.sin(angle)])
    # Its places outside of the convex hull of all sites are not known.
    unknown = np.ones(len(ring), bool)
    if line_coordinate(sites) is None:  # of a line, both sides are unknown
        edges = ConvexHull(lateral, qhull_options="QJ").equations  # of half-planes; within, all are negative
        unknown = (ring @ edges[:, :2].T + edges[:, 2] > 0).any(axis=1)
    allowed = area.allows(ring)
    return bool((unknown & allowed).any()), bool((unknown & ~allowed).any())


def footprint(places: Floats, lump: Lump, contrast: float, apart: float) -> NDArray[np.bool_]:
    """Return True (m,) for places [m] on a lump, or on its flanks down to a contrast; over a surface from above.

    A flank is taken for a Gaussian of the lump's height, with the lump's extent at half of it.
    """
    wide = np.maximum(lump.extent, 2 * apart) / FWHM
    half = wide * np.sqrt(2 * np.log(max(lump.contrast / contrast, _MIN_CONTRAST_RATIO))) + apart
    return np.asarray((((places[:, :2] - np.array(lump.place)) / half) ** 2).sum(axis=1) < 1)
