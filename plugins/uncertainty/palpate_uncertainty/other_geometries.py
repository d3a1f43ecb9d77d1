"""The uncertainty of every value by geometries that are not stated, or not known well."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import ContactModel, Diagnosed, Floats, TrackEvidence

from palpate_uncertainty.refit import depths_in_contact


def other_geometries(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the distance of each track's values from those of the other geometries that its model names.

    Nothing for an unstated geometry, which is an open fact and no uncertainty, and nothing where height and base are
    both stated: one law remains then, and its lack of fit is the model discrepancy.

    The truth is assumed to lie anywhere between the value and the farthest other: a rectangular distribution, whose
    standard uncertainty about the value is that distance over sqrt(3) (GUM 4.3.7).
    """
    findings = {}
    for track in tracks:
        depth = depths_in_contact(track)
        if not (has_open_law(track.model) and len(depth) and np.isfinite(track.values).all()):
            continue
        others = track.model.other_geometries(float(np.mean(depth)), track.values.tolist())
        if others:
            spread = spread_between(others, track.values)
            names = [parameter.name for parameter in track.model.parameters]
            table = {name: dict(zip(names, values, strict=True)) for name, values in others.items()}
            findings[track.name] = Diagnosed(terms=dict(zip(names, spread.tolist(), strict=True)), table=table)
    return findings


def has_open_law(model: ContactModel) -> bool:
    """Return True if several published laws hold for the stated geometry of the specimen."""
    thickness = getattr(model, "thickness", "")
    return thickness is not None and getattr(thickness, "bonded", None) is None


def spread_between(others: Mapping[str, Sequence[float]], values: Floats) -> Floats:
    """Return the standard uncertainty (k,) of values by the farthest of the other geometries' values."""
    distances = [np.abs(np.array(other) - values) for other in others.values()]
    return np.asarray(np.max(distances, axis=0) / math.sqrt(3.0))
