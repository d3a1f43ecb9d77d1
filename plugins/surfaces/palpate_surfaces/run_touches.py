"""The touches of a run: the surface that was estimated in each palpation, at its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError, Surface, surface_points
from palpate_engine import is_ball, registry
from palpate_kit.runs.run_folder import RunFolder, TrackTable
from palpate_kit.runs.skin_places import skin_of, skin_places

_PAUSE = 0.3  # [s] without estimates between two palpations
_STILL = 2e-3  # [m] within which a palpation stays at its place
_LAST = 0.5  # [s] of a palpation, in which its estimate has come to rest


@dataclass(frozen=True)
class SkinTouch:
    """One of them."""

    position: tuple[float, float, float]  # [m] of the tip's end
    radius: float  # [m]
    std: float  # [m]
    name: str


def touches_of_run(folder: Path) -> Iterator[SkinTouch]:
    """Place and estimated surface of each palpation that stays at a place, in a run and its continuations.

    Of the first track that has both. Where force and height are those along a surface's normals, so is the estimated
    surface; those along one stated normal are not taken. Raises LogError without any touch, where the tip is not a
    sphere, and for such a normal.
    """
    count = 0
    for part in RunFolder(folder).parts:
        for touch in _of_part(part):
            count += 1
            yield touch
    if not count:
        raise LogError(
            f"{folder}: no palpation in it stays at a place with an estimated surface: touch point by point, with "
            "lateral_x and lateral_y in [alignment]"
        )


def _of_part(part: RunFolder) -> Iterator[SkinTouch]:
    for name, table in part.tracks.items():
        document = part.result["tracks"].get(name, {})
        if document.get("verdict") == "invalid" or not np.isfinite(table.place[table.usable]).all(axis=1).any():
            continue
        if any(flag["code"] == "lack-of-fit" for flag in document["flags"]):
            raise LogError(
                f"{part.path}: {name} does not fit its record (lack-of-fit), so that its surface is not one: where the "
                "skin is not level, palpate each place in a run of its own"
            )
        if part.settings.get("alignment", {}).get("normal") is not None:
            raise LogError(f"{part.path}: its heights are along a stated normal ([alignment] normal), not along z")
        radius = _radius(part, document["model"])
        believed = [document["surface"].get(key) for key in ("std", "combined")]
        # What a run knows beyond its estimator, such as tare and compliance, is common to its palpations.
        beyond = np.sqrt(max(believed[1] ** 2 - believed[0] ** 2, 0.0)) if None not in believed else 0.0
        skin = skin_of(part)
        if skin is not None:
            table = replace(table, place=skin_places(skin, table.place, table.position))
        for number, rows in enumerate(_stays(table), 1):
            place = table.place[rows].mean(axis=0)
            height, std = (float(np.mean(table.others[key][rows])) for key in ("surface", "surface_std"))
            label = f"{part.path.name}, palpation {number}"
            end = (float(place[0]), float(place[1]), height) if skin is None else _end(skin, place, height, radius)
            yield SkinTouch(end, radius, float(np.hypot(std, beyond)), label)
        return


def _end(skin: Surface, place: Floats, height: float, radius: float) -> tuple[float, float, float]:
    """End (3,) [m] of an upright tool with the same sphere as one along the normal, at a height over a surface."""
    points = surface_points(skin, place[None])
    normal = points.normal[0]
    x, y, z = (points.position[0] + height * normal + radius * (normal - np.array([0.0, 0.0, 1.0]))).tolist()
    return x, y, z


def _stays(table: TrackTable) -> Iterator[Any]:
    """Rows of the last half second of each palpation that stays at its place."""
    rows = np.flatnonzero(table.usable & np.isfinite(table.place).all(axis=1) & (table.others["surface_std"] > 0))
    if not len(rows):
        return
    moved = np.linalg.norm(np.diff(table.place[rows], axis=0), axis=1) > _STILL
    for stay in np.split(rows, np.flatnonzero((np.diff(table.time[rows]) > _PAUSE) | moved) + 1):
        if np.ptp(table.place[stay], axis=0).max() <= _STILL:
            yield stay[table.time[stay] >= table.time[stay[-1]] - _LAST]


def _radius(part: RunFolder, model: str) -> float:
    """Radius [m] of the sphere that a run's tip ends with; raises LogError for any other tip."""
    settings: Mapping[str, Any] = part.settings
    tip = settings.get("model", {}).get(model, {}).get("indenter")
    tip = settings.get("indenter", {}).get(tip) if isinstance(tip, str) else tip
    if not isinstance(tip, Mapping) or not is_ball(tip, registry.load()):
        kind = tip.get("type") if isinstance(tip, Mapping) else None
        raise LogError(
            f"{part.path}: its tip is {kind or 'not known'}; where a tip touches an inclined skin is known of spheres"
        )
    return float(tip["radius"])
