"""The part of every value that geometries which are not stated, or not known well, leave open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from palpate import ContactModel, Diagnosed, Floats, TrackEvidence

from palpate_uncertainty.refit import depths_in_contact


def other_geometries(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track whose model names other geometries: how far its values may lie from theirs.

    Not where nothing is stated of the geometry, which is an open fact and no uncertainty, nor where height and base are
    both stated: one law is left then, and what it does not describe of the record is the model discrepancy.

    The truth is taken to lie anywhere between the value and the farthest of them: a rectangular distribution, whose
    standard uncertainty about the value is that distance over sqrt(3) (GUM 4.3.7).
    """
    found = {}
    for track in tracks:
        depth = depths_in_contact(track)
        if has_open_law(track.model) and len(depth) and np.isfinite(track.values).all():
            others = track.model.other_geometries(float(np.mean(depth)), track.values.tolist())
            if others:
                spread = spread_between(others, track.values)
                names = [parameter.name for parameter in track.model.parameters]
                table = {name: dict(zip(names, values, strict=True)) for name, values in others.items()}
                found[track.name] = Diagnosed(terms=dict(zip(names, spread.tolist(), strict=True)), table=table)
    return found


def has_open_law(model: ContactModel) -> bool:
    """Return True where several published laws are of what is stated of the specimen's geometry."""
    thickness = getattr(model, "thickness", "")
    return thickness is not None and getattr(thickness, "bonded", None) is None


def spread_between(others: Mapping[str, Sequence[float]], values: Floats) -> Floats:
    """Standard uncertainty (k,) of values by the farthest of others."""
    return np.asarray(np.max([np.abs(np.array(one) - values) for one in others.values()], axis=0) / math.sqrt(3.0))
