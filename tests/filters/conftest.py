"""Real recordings, outside the repository; tests that want them skip where they are absent."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from palpate import Samples

_SHARED = Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[3] / "shared"))

Recording = Callable[[str, int], tuple[Samples, np.ndarray]]


@pytest.fixture(scope="session")
def recording() -> Recording:
    """Samples of a recording whose motion is so many samples late, and its table (columns as in data/README.md)."""
    folder = _SHARED / "data" / "ur3e-bota-2024"
    if not folder.is_dir():
        pytest.skip(f"the recordings are not at {folder} (PALPATE_SHARED says where the folder `shared` is)")
    return lambda name, lateness: _read(folder / f"{name}.csv.gz", lateness)


def _read(path: Path, lateness: int) -> tuple[Samples, np.ndarray]:
    table = np.loadtxt(path, delimiter=",")
    motion = table[max(lateness, 0) : len(table) + min(lateness, 0)]
    force = table[max(-lateness, 0) : len(table) - max(lateness, 0), 4]
    n = len(motion)
    stamp = np.arange(n, dtype=np.int64) * 2_000_000
    interval = np.full(n, 0.002)
    interval[0] = 0.0
    touched = np.cumsum(force > 0.25) > 2
    position, velocity = motion[:, 0] / 1e3, -motion[:, 3] / 1e3
    return Samples(stamp, stamp / 1e9, interval, force, position, velocity, touched, touched.copy()), motion
