"""A map on a surface from three sides: from above, from the front and from the right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit

from palpate_kit.figures import WIDTHS, figure_of, style
from palpate_kit.runs.exclusion_figure import draw_exclusion
from palpate_kit.runs.lump_marks import CROSS, mark_lumps
from palpate_kit.runs.surface_map_file import SurfaceMap

# The axes that a view shows, and the one along which it looks, with the sign of what looks at the viewer.
_VIEWS = (("from above", (0, 1), 2, 1.0), ("from the front", (0, 2), 1, -1.0), ("from the right", (1, 2), 0, 1.0))
_NAMES = "xyz"


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
    curve is in a row of its own.
    """
    figure, axes = figure_of(3, 3 if excluded else 2, width, 55.0)
    name, factor = display_unit(surface_map.unit)
    label = f"{surface_map.parameter.replace('_', ' ')} [{name}]"
    low, high = surface_map.limits
    value = (factor * surface_map.value, label, "viridis", (factor * low, factor * high))
    share = 100 * surface_map.std / surface_map.value
    rows = (value, (share, "standard deviation [%]", "magma", (float(share.min()), float(share.max()) * (1 + 1e-9))))
    for row, (values, title, colours, limits) in zip(axes[:2], rows, strict=True):
        shown = [
            _draw(axis, surface_map, values, colours, limits, view) for axis, view in zip(row, _VIEWS, strict=True)
        ]
        for axis, view in zip(row, _VIEWS, strict=True):
            for place, mark in ((sites, "."), (np.array(lumps).reshape(-1, 4)[:, :3], "+")):
                _mark(axis, place, mark, view)
        figure.colorbar(shown[-1], ax=row[-1], shrink=0.8, label=title)
    mark_lumps(axes[0, 0], [(1e3 * x, 1e3 * y, p) for x, y, _, p in lumps])
    if excluded:
        draw_exclusion(axes[2, 0], excluded)
        for axis in axes[2, 1:]:
            axis.set_axis_off()
    return figure


def _draw(
    axis: Any, surface_map: SurfaceMap, values: Floats, colours: str, limits: tuple[float, float], view: Any
) -> Any:
    """Draw the triangles that look at the viewer, the nearest last, and return them."""
    from matplotlib.collections import PolyCollection

    title, (across, up), along, sign = view
    # A triangle looks at the viewer where its normal has that direction.
    corners = surface_map.vertices[surface_map.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.flatnonzero(sign * normal[:, along] > 0)
    facing = facing[np.argsort(sign * corners[facing, :, along].mean(axis=1), kind="stable")]
    collection: Any = PolyCollection
    triangles = collection(
        1e3 * corners[facing][:, :, (across, up)],
        array=values[surface_map.faces[facing]].mean(axis=1),
        cmap=colours,
        clim=limits,
        edgecolors="face",
        linewidths=0.4,
    )
    axis.add_collection(triangles)
    axis.autoscale_view()
    axis.set_aspect("equal")
    axis.grid(False)
    axis.set(title=title, xlabel=f"{_NAMES[across]} [mm]", ylabel=f"{_NAMES[up]} [mm]")
    return triangles


def _mark(axis: Any, places: Floats | None, mark: str, view: Any) -> None:
    """Draw a view's marks of places (n, 3) [m]; sites only in the view from above."""
    _, (across, up), along, _ = view
    if places is None or not len(places) or (along != 2 and mark == "."):
        return
    style = {"color": "white", "markersize": 1.5} if mark == "." else CROSS
    axis.plot(1e3 * places[:, across], 1e3 * places[:, up], mark, **style)
