"""The shape of a tip from its contact radius, for pictures and checks."""

from __future__ import annotations

import numpy as np

from palpate.contact.interfaces import Indenter
from palpate.vectors import Floats

_PANELS = 2000  # a choice: of the midpoint rule, whose heights are then right to 1e-4 of the depth
_POWER = 4  # panels are even in d^(1/4): narrow at the apex, where the radius rises steeply
_MIN_RADIUS = 1e-300  # [m], a choice: keeps a quotient finite at the axis


def tip_profile(indenter: Indenter, depth: float, points: int = 200) -> tuple[Floats, Floats]:
    """Return radii (n,) [m] and heights z = f(r) (n,) [m] of a tip, out to its contact radius at a depth [m].

    The inverse of the MDR transformation, f(r) = (2/pi) integral of acos(a(d)/r) over d where a(d) < r, by the midpoint
    rule in d^(1/4): heights are right to some 1e-4 of the depth. A tip with a flat face begins at the face's edge. The
    number of `points` is a choice, enough for a picture.
    Source: Popov and Hess 2015 (inverse transformation), integrated by parts.
    """
    # The contact radius at the middle of each panel of depth.
    edges = depth * np.linspace(0.0, 1.0, _PANELS + 1) ** _POWER
    middles, widths = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    contact = np.asarray(indenter.contact_radius(middles), float)
    radii = np.linspace(0.0, float(np.real(indenter.contact_radius(depth))), points)
    # The integral for each radius.
    heights = []
    for r in radii.tolist():
        cosine = np.minimum(contact / max(r, _MIN_RADIUS), 1.0)
        heights.append(float(np.sum(widths * np.arccos(cosine))))
    return radii, 2.0 / np.pi * np.array(heights)
