"""A map on a surface from three sides: from above, from the front and from the right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from palpate import Floats
from palpate_engine import display_unit

from palpate_kit.figures import WIDTHS, figure_of, style
from palpate_kit.runs.exclusion_figure import draw_exclusion
from palpate_kit.runs.lump_marks import CROSS, mark_lumps
from palpate_kit.runs.surface_map_file import SurfaceMap


class _View(NamedTuple):
    """A view of the map: the axes that it shows, and the one along which it looks, as numbers of x, y, z."""

    title: str
    across: int
    up: int
    along: int
    sign: float  # of the normal along that axis of a triangle that looks at the viewer


class _MapLayer(NamedTuple):
    """A quantity that is drawn: numbers (n,) of the vertices, with label, colour map and limits of the colours."""

    values: Floats
    label: str
    colours: str
    limits: tuple[float, float]


_VIEWS = (
    _View("from above", 0, 1, 2, 1.0),
    _View("from the front", 0, 2, 1, -1.0),
    _View("from the right", 1, 2, 0, 1.0),
)
_NAMES = "xyz"
_ROW_HEIGHT = 55.0  # [mm], a choice
_TOP_MARGIN = 1e-9  # of the largest share, so that limits of a uniform map differ


@style()
def surface_map_figure(
    surface_map: SurfaceMap,
    sites: Floats | None = None,
    lumps: Sequence[Sequence[float]] = (),
    width: float = WIDTHS["double"],
    excluded: Sequence[Mapping[str, float | None]] = (),
) -> Any:
    """Draw value and its relative standard deviation from three sides, with sites (n, 3) [m] as dots.

    Crosses are lumps x, y, z [m], p; they have number and p in the view from above. With lumps that are excluded, their
    curve, contrasts over widths, is in a row of its own. `width` is that of the figure [mm].
    """
    figure, axes = figure_of(3, 3 if excluded else 2, width, _ROW_HEIGHT)
    lump_places = np.array(lumps).reshape(-1, 4)[:, :3]  # without their p
    for row, layer in zip(axes[:2], _layers(surface_map), strict=True):
        triangles = None
        for axis, view in zip(row, _VIEWS, strict=True):
            triangles = _draw(axis, surface_map, layer, view)
            if sites is not None and view.title == "from above":
                _mark(axis, sites, ".", view, {"color": "white", "markersize": 1.5})
            _mark(axis, lump_places, "+", view, CROSS)
        figure.colorbar(triangles, ax=row[-1], shrink=0.8, label=layer.label)
    mark_lumps(axes[0, 0], [(1e3 * x, 1e3 * y, p) for x, y, _, p in lumps])
    if excluded:
        draw_exclusion(axes[2, 0], excluded)
        for axis in axes[2, 1:]:
            axis.set_axis_off()
    return figure


def _layers(surface_map: SurfaceMap) -> tuple[_MapLayer, _MapLayer]:
    """Return the value in its display unit, and its relative standard deviation [%]."""
    unit, factor = display_unit(surface_map.unit)
    low, high = surface_map.limits
    label = f"{surface_map.parameter.replace('_', ' ')} [{unit}]"
    share = 100 * surface_map.std / surface_map.value
    share_limits = (float(share.min()), float(share.max()) * (1 + _TOP_MARGIN))
    return (
        _MapLayer(factor * surface_map.value, label, "viridis", (factor * low, factor * high)),
        _MapLayer(share, "standard deviation [%]", "magma", share_limits),
    )


def _draw(axis: Any, surface_map: SurfaceMap, layer: _MapLayer, view: _View) -> Any:
    """Draw the triangles of a map that look at the viewer, the nearest last, coloured by a layer; return them."""
    from matplotlib.collections import PolyCollection

    # A triangle looks at the viewer where its normal has that direction.
    corners = surface_map.vertices[surface_map.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.flatnonzero(view.sign * normal[:, view.along] > 0)
    distances = view.sign * corners[facing, :, view.along].mean(axis=1)
    facing = facing[np.argsort(distances, kind="stable")]
    # Thin edges in the colour of the faces close the seams between triangles.
    collection: Any = PolyCollection
    triangles = collection(
        1e3 * corners[facing][:, :, (view.across, view.up)],
        array=layer.values[surface_map.faces[facing]].mean(axis=1),
        cmap=layer.colours,
        clim=layer.limits,
        edgecolors="face",
        linewidths=0.4,
    )
    axis.add_collection(triangles)
    axis.autoscale_view()
    axis.set_aspect("equal")
    axis.grid(False)
    axis.set(title=view.title, xlabel=f"{_NAMES[view.across]} [mm]", ylabel=f"{_NAMES[view.up]} [mm]")
    return triangles


def _mark(axis: Any, places: Floats, mark: str, view: _View, look: Mapping[str, Any]) -> None:
    """Draw a view's marks of places (n, 3) [m]; nothing of none."""
    if len(places):
        axis.plot(1e3 * places[:, view.across], 1e3 * places[:, view.up], mark, **look)
