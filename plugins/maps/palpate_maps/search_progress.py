"""What a search knows of each lump, from round to round, and when nothing remains to be found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.lump_criteria import Findings, Lump
from palpate_maps.next_places import SETTLED, is_placed, lumps_apart, passes
from palpate_maps.search_area import Area
from palpate_maps.sites import Sites, line_coordinate

CHECKS = 2  # points at a place, or lines across it, from which on it is checked
SUSPICIOUS = 0.5  # probability of a contrast above the threshold that calls for a visit
_RING = 4e-3  # [m] around the stiffest place of a lump that has to be known, for its middle to be inside


@dataclass(frozen=True)
class LumpProgress:
    """One lump in a search."""

    lump: Lump
    certain: bool  # checked by a point or two lines, significant, and in place since the round before
    beyond: bool  # its stiffest place lies at the border of what was palpated, and more may be palpated there
    cut: bool  # its stiffest place lies at the border of what may be palpated

    @property
    def done(self) -> bool:
        """Whether nothing more is to be learned of it here."""
        return self.certain and not self.beyond


def update_progress(
    findings: Findings, before: Sequence[LumpProgress], sites: Sites, area: Area, sure: float
) -> list[LumpProgress]:
    """Every lump of a round against those of the round before; the surest first."""
    found = []
    for lump in sorted(findings.lumps, key=lambda lump: lump.p):
        old = min((w.lump for w in before), key=lambda other: lumps_apart(other, lump, area.lift), default=None)
        open_, cut = borders(sites, lump, area)
        top = area.lift(np.array([lump.highest or lump.place]))
        checked = lump.checked or passes(sites, top, SETTLED)[0] >= CHECKS
        certain = checked and is_placed(old, lump, sure, area.lift)
        found.append(LumpProgress(lump, certain, beyond=open_, cut=cut))
    return found


def borders(sites: Sites, lump: Lump, area: Area) -> tuple[bool, bool]:
    """Whether a lump's stiffest place lies at the border of what is known: one to cross, one not to cross."""
    from scipy.spatial import ConvexHull

    middle = area.lift(np.array([lump.place]))
    near = np.linalg.norm(sites.place - middle, axis=1) <= max(*lump.extent, 2 * SETTLED)
    rows = np.flatnonzero(near)
    if not len(rows):
        return False, False
    lateral = sites.place[:, :2]
    peak = lateral[rows[int(np.argmax(sites.log[rows]))]]
    turn = np.arange(8) * np.pi / 4
    ring = peak + _RING * np.column_stack([np.cos(turn), np.sin(turn)])
    unknown = np.ones(len(ring), bool)
    if line_coordinate(sites) is None:  # of a line, both sides are unknown
        edges = ConvexHull(lateral, qhull_options="QJ").equations  # of half-planes; within, all are negative
        unknown = (ring @ edges[:, :2].T + edges[:, 2] > 0).any(axis=1)
    allowed = area.allows(ring)
    return bool((unknown & allowed).any()), bool((unknown & ~allowed).any())


def footprint(places: Floats, lump: Lump, contrast: float, apart: float) -> NDArray[np.bool_]:
    """(m,) which places [m] lie on a lump, or on its flanks down to a contrast; over a surface as seen from above.

    A flank is taken for a Gaussian of the lump's height, with the lump's extent at half of it.
    """
    wide = np.maximum(lump.extent, 2 * apart) / 2.355
    half = wide * np.sqrt(2 * np.log(max(lump.contrast / contrast, 1.5))) + apart
    return np.asarray((((places[:, :2] - np.array(lump.place)) / half) ** 2).sum(axis=1) < 1)
