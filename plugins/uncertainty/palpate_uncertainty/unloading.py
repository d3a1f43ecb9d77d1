"""Unloading under a model whose contact follows the depth, though the material has memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, TrackEvidence

_MAX_DEPTH_SHARE = 0.5  # of the largest depth (choice); an oscillation above it moves the contact's edge little


def unloading(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the flag of each track that used a whole unloading of a model with memory.

    Estimators that have Ting's law of the unloading (1966) get no flag.
    """
    findings = {}
    for track in tracks:
        if not track.model.memory or getattr(track.estimator, "unloading", "following") == "ting":
            continue
        depth = track.surface - track.kept.position[track.kept.used]
        depth = depth[np.isfinite(depth)]
        if not len(depth):
            continue
        deepest = int(np.argmax(depth))
        share = float(depth[deepest:].min()) / float(depth.max())
        if share < _MAX_DEPTH_SHARE:
            percent = 100 * max(share, 0.0)
            text = f"the tip came back to {percent:.0f} % of its depth; the contact is smaller in unloading"
            findings[track.name] = Diagnosed((Flag("unloading", text),))
    return findings
