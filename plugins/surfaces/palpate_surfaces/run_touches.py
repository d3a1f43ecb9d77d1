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

# Choices.
_MIN_PAUSE = 0.3  # [s] without estimates between two palpations
_SAME_PLACE = 2e-3  # [m] within which a palpation stays at its place
_SETTLED_TIME = 0.5  # [s] at the end of a palpation, in which its estimate has settled


@dataclass(frozen=True)
class SkinTouch:
    """A place where a tip met the skin."""

    position: tuple[float, float, float]  # [m] of the tip's end
    radius: float  # [m] of the sphere that the tip ends with; 0 where the place is one of the skin itself
    std: float  # [m]
    name: str


def touches_of_run(folder: Path) -> Iterator[SkinTouch]:
    """Yield place and estimated surface of each palpation that stays at a place, in a run and its continuations.

    Of the first track that has both. Where force and height are those along a surface's normals, so is the estimated
    surface; those along one stated normal are not taken. Raises LogError without any touch, where the tip is not a
    sphere, and for such a normal.
    """
    count = 0
    for part in RunFolder(folder).parts:
        for touch in _part_touches(part):
            count += 1
            yield touch
    if not count:
        raise LogError(
            f"{folder}: no palpation in it stays at a place with an estimated surface: touch point by point, with "
            "lateral_x and lateral_y in [alignment]"
        )


def _part_touches(part: RunFolder) -> Iterator[SkinTouch]:
    """Yield the touches of the first valid track with places in a part of a run; raises LogError (`touches_of_run`)."""
    for name, table in part.tracks.items():
        document = part.result["tracks"].get(name, {})
        has_places = np.isfinite(table.place[table.usable]).all(axis=1).any()
        if document.get("verdict") == "invalid" or not has_places:
            continue
        _check_heights(part, name, document)
        yield from _track_touches(part, table, document)
        return


def _check_heights(part: RunFolder, name: str, document: Mapping[str, Any]) -> None:
    """Raise LogError for a track whose surface is not that of its skin, or not along z."""
    if any(flag["code"] == "lack-of-fit" for flag in document["flags"]):
        raise LogError(
            f"{part.path}: {name} does not fit its record (lack-of-fit), so that its surface is not one: where the "
            "skin is not level, palpate each place in a run of its own"
        )
    if part.settings.get("alignment", {}).get("normal") is not None:
        raise LogError(f"{part.path}: its heights are along a stated normal ([alignment] normal), not along z")


def _track_touches(part: RunFolder, table: TrackTable, document: Mapping[str, Any]) -> Iterator[SkinTouch]:
    """Yield the touches of a track by its table of estimates and its document of results."""
    radius = _sphere_radius(part, document["model"])
    common_std = _common_std(document["surface"])
    skin = skin_of(part)
    if skin is not None:
        table = replace(table, place=skin_places(skin, table.place, table.position))
    for number, rows in enumerate(_settled_rows(table), 1):
        place = table.place[rows].mean(axis=0)
        height = float(np.mean(table.others["surface"][rows]))
        std = float(np.mean(table.others["surface_std"][rows]))
        if skin is None:
            position = float(place[0]), float(place[1]), height
        else:
            position = _upright_end(skin, place, height, radius)
        label = f"{part.path.name}, palpation {number}"
        yield SkinTouch(position, radius, float(np.hypot(std, common_std)), label)


def _common_std(surface: Mapping[str, Any]) -> float:
    """Return the standard uncertainty [m] of a result's surface that all palpations of the run have in common.

    The combined one holds tare, compliance and others beyond the estimator's own. 0 where one of both is missing.
    """
    estimator_std, combined_std = surface.get("std"), surface.get("combined")
    if estimator_std is None or combined_std is None:
        return 0.0
    return float(np.sqrt(max(combined_std**2 - estimator_std**2, 0.0)))


def _upright_end(skin: Surface, place: Floats, height: float, radius: float) -> tuple[float, float, float]:
    """Return the end (3,) [m] of an upright tool with the same sphere as one along the normal of a surface.

    The tool along the normal has its end at a height [m] over the surface at a place (3,); the centre of its sphere of
    a radius r is r along the normal from there, and the upright tool's end r below it.
    """
    points = surface_points(skin, place[None])
    normal = points.normal[0]
    x, y, z = (points.position[0] + height * normal + radius * (normal - np.array([0.0, 0.0, 1.0]))).tolist()
    return x, y, z


def _settled_rows(table: TrackTable) -> Iterator[Any]:
    """Yield the rows of the last half second of each palpation that stays at its place."""
    has_place = np.isfinite(table.place).all(axis=1)
    rows = np.flatnonzero(table.usable & has_place & (table.others["surface_std"] > 0))
    if not len(rows):
        return
    # A palpation ends with a pause, or with a step aside.
    step = np.linalg.norm(np.diff(table.place[rows], axis=0), axis=1)
    is_end = (np.diff(table.time[rows]) > _MIN_PAUSE) | (step > _SAME_PLACE)
    for palpation in np.split(rows, np.flatnonzero(is_end) + 1):
        if np.ptp(table.place[palpation], axis=0).max() <= _SAME_PLACE:
            yield palpation[table.time[palpation] >= table.time[palpation[-1]] - _SETTLED_TIME]


def _sphere_radius(part: RunFolder, model: str) -> float:
    """Return the radius [m] of the sphere that the tip of a model in a run ends with; raises LogError otherwise."""
    settings: Mapping[str, Any] = part.settings
    tip = settings.get("model", {}).get(model, {}).get("indenter")
    tip = settings.get("indenter", {}).get(tip) if isinstance(tip, str) else tip
    if not isinstance(tip, Mapping) or not is_ball(tip, registry.load()):
        tip_type = tip.get("type") if isinstance(tip, Mapping) else None
        raise LogError(
            f"{part.path}: its tip is {tip_type or 'not known'}; "
            "where a tip touches an inclined skin is known of spheres"
        )
    return float(tip["radius"])
