"""The thickness of the specimen, where it is not declared."""

from __future__ import annotations

import numpy as np
from palpate import Indenter, TrackEvidence

from palpate_uncertainty.refit import depths_in_contact

BONDED_COEFFICIENTS = (1.133, 1.283, 0.769, 0.0975)  # of X, X^2, ...: Dimitriadis et al. 2002, eq. 13
MIN_ELASTICITY_SHARE = 0.05  # of the elasticity (choice), by which a layer may be stiffer than a half-space


def stiffer_by(radius: float, height: float) -> float:
    """Return the share by which a layer of a height [m] is stiffer than the half-space, at a contact radius [m].

    1.133 X + 1.283 X^2 + 0.769 X^3 + 0.0975 X^4 of X = radius/height (Dimitriadis et al. 2002, eq. 13).
    """
    x = radius / height
    c1, c2, c3, c4 = BONDED_COEFFICIENTS
    return x * (c1 + x * (c2 + x * (c3 + x * c4)))


def half_space_from(track: TrackEvidence, share: float = MIN_ELASTICITY_SHARE) -> float | None:
    """Return the thickness [m] above which the elasticity is within a share, to first order; None for a layer."""
    radius = _contact_radius(track)
    return None if radius is None else radius * BONDED_COEFFICIENTS[0] / share


def _contact_radius(track: TrackEvidence) -> float | None:
    """Return the mean contact radius [m] on a half-space; None if a thickness is stated, or the model has none."""
    tip, thickness = getattr(track.model, "indenter", None), getattr(track.model, "thickness", None)
    if "thickness" not in type(track.model).model_fields or not isinstance(tip, Indenter):
        return None
    depth = depths_in_contact(track)
    if thickness not in (None, "half-space") or not len(depth):
        return None
    radius = float(tip.contact_radius(float(np.mean(depth))))
    return radius if np.isfinite(radius) else None
