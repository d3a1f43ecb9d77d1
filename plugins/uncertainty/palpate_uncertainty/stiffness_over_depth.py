"""Elasticity over depth: the slope of a press against its law in thirds of the depth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Diagnosed, Floats, TrackEvidence, contact_force

from palpate_uncertainty.whiteness import oscillation

# Choices, of a table that is shown: no verdict depends on them.
EDGES = (0.1, 1 / 3, 2 / 3, 1.0)  # of the deepest depth; a slope above the first depends on the surface
FEWEST_SAMPLES = 20  # of a stretch
LARGEST_CORRELATION = 0.99  # of neighbouring residuals, beyond which a stretch has no independent samples


@dataclass(frozen=True)
class Slope:
    """A modulus over one stretch of depth."""

    value: float  # [SI] of the elastic parameter
    std: float  # by the scatter about the slope


def stiffness_over_depth(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return a table of the moduli over depth of each track on a press whose law has one elastic parameter."""
    tables = {track.name: _table(track) for track in tracks if not (track.ending and track.ending.is_sweep)}
    return {name: Diagnosed(table=table) for name, table in tables.items() if table}


def _table(track: TrackEvidence) -> dict[str, Any]:
    """Return `parameter`, `depth` (4,) [m], `values` and `std` (3,) [SI]; empty for another motion or law."""
    # A law of one modulus without memory, on a press or a ramp: an oscillation sees all depths at once.
    elastic = [i for i, parameter in enumerate(track.model.parameters) if parameter.role == "elastic"]
    rows = track.kept.used & np.isfinite(track.kept.position) & np.isfinite(track.kept.velocity)
    depth = (track.surface - track.kept.position)[rows]
    if len(elastic) != 1 or track.model.memory or not len(depth) or not np.max(depth) > 0:
        return {}
    modulus = float(track.values[elastic[0]])
    if not modulus or oscillation(track.kept.time[rows], track.kept.position[rows]) is not None:
        return {}
    # The modulus on each part of the depth: the slope of the force over that of the law with a modulus of 1.
    edges = [part * float(np.max(depth)) for part in EDGES]
    slopes = _slopes(track, rows, edges, modulus)
    if not slopes:
        return {}
    name = track.model.parameters[elastic[0]].name
    values, std = [slope.value for slope in slopes], [slope.std for slope in slopes]
    return {"parameter": name, "depth": edges, "values": values, "std": std}


def _slopes(track: TrackEvidence, rows: NDArray[np.bool_], edges: Sequence[float], modulus: float) -> list[Slope]:
    """Return the modulus between each two edges [m] of the depth; empty if one has too few samples.

    `rows` (n,) are the kept samples that are judged, `modulus` is the track's own one. The force less its viscous part
    is compared with that of a unit modulus at rest, of the way in alone: the way out of a material that dissipates has
    another slope.
    """
    depth, rate = (track.surface - track.kept.position)[rows], -track.kept.velocity[rows]
    theta = track.values.tolist()
    force_at_rest = np.asarray(contact_force(track.model, depth, 0.0, theta))
    viscous_force = np.asarray(contact_force(track.model, depth, rate, theta)) - force_at_rest
    elastic_force = track.kept.force[rows] - viscous_force
    is_inward = np.arange(len(depth)) <= int(np.argmax(depth))
    slopes: list[Slope] = []
    for low, high in pairwise(edges):
        stretch = is_inward & (depth > low) & (depth <= high)
        slope = slope_of(force_at_rest[stretch] / modulus, elastic_force[stretch])
        if slope is None:
            return []
        slopes.append(slope)
    return slopes


def slope_of(unit_force: Floats, force: Floats) -> Slope | None:
    """Return the slope of a force (n,) [N] over that of a unit modulus (n,); None for too few samples.

    Its variance is that of least squares, times (1 + r)/(1 - r) for residuals of a correlation r from one sample to the
    next (Bartlett 1946).
    """
    n = len(force)
    if n < FEWEST_SAMPLES or not np.ptp(unit_force) > 0:
        return None
    centred = unit_force - np.mean(unit_force)
    spread = float(centred @ centred)
    slope = float(centred @ force) / spread
    residual = force - np.mean(force) - slope * centred
    variance = float(residual @ residual) / (n - 2)  # slope and mean are fitted
    if variance == 0.0:
        return Slope(slope, 0.0)
    correlation = float(residual[1:] @ residual[:-1] / (residual @ residual))
    correlation = min(max(correlation, 0.0), LARGEST_CORRELATION)
    return Slope(slope, math.sqrt(variance / spread * (1 + correlation) / (1 - correlation)))
