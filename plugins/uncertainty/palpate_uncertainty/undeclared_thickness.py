"""The thickness of the specimen, where it is not declared."""

from __future__ import annotations

import numpy as np
from palpate import Indenter, TrackEvidence

from palpate_uncertainty.refit import depths_in_contact

_BONDED_COEFFICIENTS = (1.133, 1.283, 0.769, 0.0975)  # of X, X^2, ...: Dimitriadis et al. 2002, eq. 13
_MIN_ELASTICITY_SHARE = 0.05  # of the elasticity


def stiffer_by(radius: float, height: float) -> float:
    """By what share a layer of a height [m] is stiffer under a contact of a radius [m] than the half-space."""
    share = radius / height
    return share * (
        _BONDED_COEFFICIENTS[0]
        + share * (_BONDED_COEFFICIENTS[1] + share * (_BONDED_COEFFICIENTS[2] + share * _BONDED_COEFFICIENTS[3]))
    )


def half_space_from(track: TrackEvidence, share: float = _MIN_ELASTICITY_SHARE) -> float | None:
    """Return how thick [m] the specimen has to be for its elasticity to be within a share; None for a layer."""
    radius = _contact_radius(track)
    return None if radius is None else radius * _BONDED_COEFFICIENTS[0] / share


def _contact_radius(track: TrackEvidence) -> float | None:
    """Mean contact radius [m] on a half-space; None where a thickness is stated, or the model knows of none."""
    tip, thickness = getattr(track.model, "indenter", None), getattr(track.model, "thickness", None)
    if "thickness" not in type(track.model).model_fields or not isinstance(tip, Indenter):
        return None
    depth = depths_in_contact(track)
    if thickness not in (None, "half-space") or not len(depth):
        return None
    radius = float(tip.contact_radius(float(np.mean(depth))))
    return radius if np.isfinite(radius) else None
