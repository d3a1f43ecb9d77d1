"""Unloading under a model whose contact follows the depth, though the material has memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence

_MAX_DEPTH_SHARE = 0.5  # of the largest depth; an oscillation above it moves the contact's edge little


def unloading(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Flags tracks that used a whole unloading of a model with memory, but for estimators that take it as Ting did."""
    found = {}
    for track in tracks:
        if not track.model.memory or getattr(track.estimator, "unloading", "following") == "ting":
            continue
        depth = track.surface - track.kept.position[track.kept.used]
        depth = depth[np.isfinite(depth)]
        if len(depth) and (left := float(depth[int(np.argmax(depth)) :].min()) / float(depth.max())) < _MAX_DEPTH_SHARE:
            text = (
                f"the tip came back to {100 * max(left, 0.0):.0f} % of its depth; the contact is smaller in unloading"
            )
            found[track.name] = Diagnosed((Flag("unloading", text),))
    return found
