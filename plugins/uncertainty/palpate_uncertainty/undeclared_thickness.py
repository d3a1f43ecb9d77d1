"""What is not declared of the specimen: its thickness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, Indenter, TrackEvidence

from palpate_uncertainty.refit import depths_in_contact

_BONDED = (1.133, 1.283, 0.769, 0.0975)  # of X, X^2, ...: Dimitriadis et al. 2002, eq. 13
_MATTERS = 0.05  # of the elasticity
_THIN = 30e-3  # [m]; who needs less than this for 5 % need not be asked
_USUAL = 22e-3  # [m]


def geometry(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track whose model could correct for a thickness, and of which none is declared.

    On a layer of height h the force of the half-space is 1 + 1.133 X + ... times as large, X = a/h, bonded to its base,
    and so is an elasticity that does not account for it. h is not known, so there is no uncertainty: the flag states
    how thick the specimen has to be.
    """
    found = {track.name: _of(track) for track in tracks}
    return {name: diagnosed for name, diagnosed in found.items() if diagnosed is not None}


def stiffer_by(radius: float, height: float) -> float:
    """By what share a layer of a height [m] is stiffer under a contact of a radius [m] than the half-space."""
    share = radius / height
    return share * (_BONDED[0] + share * (_BONDED[1] + share * (_BONDED[2] + share * _BONDED[3])))


def half_space_from(track: TrackEvidence) -> float | None:
    """How thick [m] the specimen has to be for its elasticity to be within 5 %; None where a thickness is stated."""
    radius = _contact_radius(track)
    return None if radius is None else radius * _BONDED[0] / _MATTERS


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


def _of(track: TrackEvidence) -> Diagnosed | None:
    radius, needed = _contact_radius(track), half_space_from(track)
    if getattr(track.model, "thickness", None) is not None or radius is None or needed is None or needed < _THIN:
        return None
    table = {"contact_radius": radius, "half_space_from": needed}
    share = stiffer_by(radius, _USUAL)
    if not _is_material(track, share):
        return Diagnosed(table=table)
    text = (
        f"no thickness of the specimen is declared: below {1e3 * needed:.0f} mm an elasticity is over 5 % too high, "
        f"at {1e3 * _USUAL:.0f} mm by {100 * share:.0f} % (contact radius {1e3 * radius:.2g} mm)"
    )
    return Diagnosed((Flag("thickness-undeclared", text),), table=table)


def _is_material(track: TrackEvidence, share: float) -> bool:
    """Whether a share of an elastic parameter is more than its combined uncertainty."""
    parameters = zip(track.model.parameters, track.values.tolist(), track.combined.tolist(), strict=True)
    return any(p.role == "elastic" and not share * abs(value) <= combined for p, value, combined in parameters)
