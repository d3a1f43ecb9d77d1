"""The skin of a recorded run: the surface along whose normals it is, below where it was palpated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate import Extent, Surface
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.skin_places import skin_of


def skin_and_extent(source: Path) -> tuple[Surface | None, Extent | None]:
    """Surface of a run folder, None where it has none, and box of its palpated places, None without any."""
    folder = RunFolder(source)
    surface = skin_of(folder) if source.is_dir() else None
    if surface is None:
        return None, None
    places = [track.place for table in folder.tables for track in (table.track(name) for name in table.tracks)]
    known = np.vstack([place[np.isfinite(place).all(axis=1)] for place in places])
    if not len(known):
        return surface, None
    (x0, y0), (x1, y1) = known.min(axis=0).tolist(), known.max(axis=0).tolist()
    return surface, ((x0, y0, 0.0), (x1, y1, 0.0))
