"""A skin as the view that turns has it: heights over a grid in x and y, values at its nodes, and lumps to outline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Extent, Floats, Surface
from palpate_engine import bounded_text, display_unit, json_document

from palpate_kit.runs.surface_map_file import SurfaceMap

_NODES = 41  # along the longer side of a surface that fills while a run goes on: a choice
_MARGIN = 3e-3  # [m] of skin about the planned motion: a choice
_MILLIMETRES = 1e3  # in a metre
_AXIS_DIGITS, _HEIGHT_DIGITS = 3, 2  # of millimetres, 1 um and 10 um: a choice, for short messages


def skin_over(surface: Surface, extent: Extent) -> dict[str, Any]:
    """Return a surface below the box [m] of a motion, lowest and highest x, y, z.

    As axes [from, to, count] and heights in mm, None where the surface is unknown.
    """
    (x0, y0, *_), (x1, y1, *_) = extent
    axes = (x0 - _MARGIN, x1 + _MARGIN), (y0 - _MARGIN, y1 + _MARGIN)
    step = max(high - low for low, high in axes) / (_NODES - 1)
    x, y = (np.linspace(low, high, max(round((high - low) / step), 1) + 1) for low, high in axes)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return _grid(x, y, surface.uppermost(places).position[:, 2])


def skin_of_map(surface_map: SurfaceMap, lumps: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a map on a surface with its values, their scale and its lumps, in the units that are shown.

    The map's vertices are those of a grid over x and y; places of the grid that have no vertex are NaN.
    """
    name, factor = display_unit(surface_map.unit)
    (x, columns), (y, lines) = (_axis(along, surface_map.faces) for along in surface_map.vertices.T[:2])
    rows = lines, columns
    height, value = np.full((2, len(y), len(x)), np.nan)
    height[rows], value[rows] = surface_map.vertices[:, 2], factor * surface_map.value
    low, high = (_short(factor * limit) for limit in surface_map.limits)
    return {
        **_grid(x, y, height.ravel()),
        "values": [None if np.isnan(number) else _short(number) for number in value.ravel()],
        "low": low,
        "high": high,
        "label": f"{surface_map.parameter.replace('_', ' ')}, {name}",
        "lumps": lump_shapes(lumps),
    }


def _axis(coordinates: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.intp]]:
    """Return the axis (k,) [m] of a map's grid, and the place on it of each vertex (n,).

    A triangle (m, 3) is half a cell of the grid, and as wide as that; coordinates [m] of vertices are on the grid but
    for um.
    """
    # Most triangles are as wide as a cell: the median ignores those at an edge.
    low, high = float(coordinates.min()), float(coordinates.max())
    step = float(np.median(np.ptp(coordinates[faces], axis=1)))
    max_steps = max(len(coordinates) - 1, 1)  # steps, whatever a damaged file says
    step = max(step, (high - low) / max_steps) or 1.0
    count = round((high - low) / step) + 1
    return np.linspace(low, high, count), np.rint((coordinates - low) / step).astype(np.intp)


def _grid(x: Floats, y: Floats, height: Floats) -> dict[str, Any]:
    """Return axes as [from, to, count] and heights in mm, None where they are not known."""
    axes = {"x": _ends(x), "y": _ends(y)}
    heights = [None if np.isnan(z) else round(_MILLIMETRES * z, _HEIGHT_DIGITS) for z in height.tolist()]
    return {**axes, "z": heights}


def _ends(places: Floats) -> list[Any]:
    """Return the first and the last place [mm] of an axis, and how many there are."""
    first, last = (round(_MILLIMETRES * place, _AXIS_DIGITS) for place in (places[0], places[-1]))
    return [first, last, len(places)]


def _short(value: float) -> float:
    """Return a number of four digits."""
    return float(f"{value:.4g}")


def read_lumps(maps: Path) -> list[dict[str, Any]]:
    """Return the lumps that `palpate map lumps` has left in a folder of maps; none where it was not asked."""
    return list(read_lump_findings(maps).get("lumps", ()))


def read_lump_findings(maps: Path) -> dict[str, Any]:
    """Return the lumps of a folder of maps, what is excluded, and the warning; nothing where it was not asked."""
    try:
        findings = dict(json_document(bounded_text(maps / "lumps.json")))
    except (OSError, ValueError, TypeError):
        return {}
    is_whole = all(isinstance(findings.get(key, []), list) for key in ("lumps", "excluded"))
    return findings if is_whole else {}


def lump_shapes(lumps: list[dict[str, Any]]) -> list[list[float]]:
    """Return middle and extent of lumps over an area: x, y, along x, along y [mm]."""
    return [
        [round(_MILLIMETRES * length, _HEIGHT_DIGITS) for length in (lump["x"], lump["y"], *lump["extent"])]
        for lump in lumps
    ]
