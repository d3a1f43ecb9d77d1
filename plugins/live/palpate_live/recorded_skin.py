"""The skin of a recorded run: the surface along whose normals it palpated, and the box of its places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate import Extent, Surface
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.skin_places import skin_of


def skin_and_extent(source: Path) -> tuple[Surface | None, Extent | None]:
    """Return the surface of a run folder and the box [m] of its palpated places; None without the one or the other."""
    folder = RunFolder(source)
    surface = skin_of(folder) if source.is_dir() else None
    if surface is None:
        return None, None
    track_places = [table.track(track).place for table in folder.tables for track in table.tracks]
    places = np.vstack([place[np.isfinite(place).all(axis=1)] for place in track_places])
    if not len(places):
        return surface, None
    (x0, y0), (x1, y1) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    return surface, ((x0, y0, 0.0), (x1, y1, 0.0))
