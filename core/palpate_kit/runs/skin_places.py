"""The surface of a run, and where on it a tip touches that went along its normal: aside of where its end is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate import ConfigurationError, Floats, Surface

from palpate_kit.runs.continuation import recorded_pipeline
from palpate_kit.runs.run_folder import RunFolder

_CELL = 0.5e-3  # [m] within which a normal is one: on a radius of 20 mm it turns by 1.4 degrees
_ITERATIONS = 4  # of q = p - h n(q): a choice; each takes the error times the height over the skin's radius


def surface_of_run(run: Path, name: str | None = None) -> Surface | None:
    """Return the surface of a run's pipeline: the one that is named, that of its alignment, or its only one.

    None for a run without a surface. Raises ConfigurationError where it has several and none is named, or none of that
    name.
    """
    settings = RunFolder(run).settings
    if "surface" not in settings and name is None:
        return None
    name = name or settings.get("alignment", {}).get("surface")
    surfaces = recorded_pipeline(run).surfaces
    if name is None and len(surfaces) == 1:
        return next(iter(surfaces.values()))
    if name is None or name not in surfaces:
        problem = "choose one of its surfaces" if name is None else f"it has no surface {name!r}"
        raise ConfigurationError(f"--surface: {run}: {problem} (there are: {', '.join(surfaces) or 'none'})")
    return surfaces[name]


def skin_of(run: RunFolder) -> Surface | None:
    """Return the surface along whose normals force and height of a run are; None where they are along an axis."""
    name = run.settings.get("alignment", {}).get("surface") if run.began else None
    return None if name is None else surface_of_run(run.path, name)


def skin_places(surface: Surface, tip: Floats, height: Floats) -> Floats:
    """Return the places (n, 2) [m] of the skin, of tips at x and y (n, 2) [m] and heights (n,) [m] along the normal
    over it.

    q = p - h n(q), by iteration; those of tips that are nowhere over the surface stay.
    """
    foot = tip.copy()
    for _ in range(_ITERATIONS):
        cells, cell_of = np.unique(np.round(foot / _CELL), axis=0, return_inverse=True)
        aside = surface.uppermost(cells * _CELL).normal[:, :2]
        aside = np.where(np.isfinite(aside), aside, 0.0)[cell_of.ravel()]
        foot = tip - np.nan_to_num(height)[:, None] * aside
    return foot
