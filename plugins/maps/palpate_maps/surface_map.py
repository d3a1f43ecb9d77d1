"""A map on a surface: the same Gaussian process and the same p-values, over points of the skin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, Surface, surface_points
from palpate_kit.runs.surface_map_file import SurfaceMap

from palpate_maps.body_field import BodyFit
from palpate_maps.map_grid import (
    COVERED,
    LENGTH_OF_PITCH,
    MERGE_DISTANCE,
    MERGED,
    blind_width,
    cells_over,
    line_distance,
    nearest_distance,
    significance,
)
from palpate_maps.sites import Sites, merge_sites
from palpate_maps.stiffness_field import interpolated

ARC = 0.5  # [rad]: sin(a/2)/(a/2) = 0.990, so a straight distance is within 1 % of the arc (decision 0266)


@dataclass(frozen=True)
class MapOnSurface:
    """A map, and how it was made."""

    map: SurfaceMap
    stiff: NDArray[np.bool_]  # (n,) vertices stiffer than the baseline, with false discoveries controlled
    length: float  # [m] over which it was interpolated
    blind_below: float  # [m] width at half its height of a lump that may lie between the sites unseen
    reach: float  # [m] to which straight distances are within 1 % of those along the surface

    @property
    def warning(self) -> str | None:
        """The error of straight distances where the surface is curved on their scale; None where it is not."""
        return arc_warning(self.length, self.reach)


def arc_warning(length: float, reach: float) -> str | None:
    """Return a warning of an interpolation over more than the reach [m] of straight distances; None where it is over
    less."""
    if length <= reach:
        return None
    return (
        f"the map is interpolated over {1e3 * length:.3g} mm by straight distances, which are within 1 % of those "
        f"along the surface up to {1e3 * reach:.3g} mm"
    )


def sites_on(sites: Sites, surface: Surface) -> Sites:
    """Return sites at their places (n, 3) on a surface; raises ConfigurationError where it is unknown below one."""
    return replace(sites, place=surface_points(surface, sites.place).position)


def make_surface_map(
    sites: Sites, surface: Surface, cell: float, parameter: str, unit: str, fit: BodyFit | None = None
) -> MapOnSurface:
    """Return the map of sites (n, 2) on a surface, its vertices a grid of cells [m] in x and y that is laid on it.

    Distances between points are straight. A vertex is there where a site is nearer in x and y than 1.2 times the
    distance of lines or points, and the surface is known. Raises LogError for too few sites, ConfigurationError.
    """
    x, y, nodes = cells_over(sites, cell)
    pitch = line_distance(sites)
    covered = np.flatnonzero(nearest_distance(sites.place, nodes) <= COVERED * pitch)
    vertices, faces, curvature = _surface_mesh(surface, nodes, covered, columns=len(x), lines=len(y))
    # The flat map's process and test, over places in space.
    lifted = sites_on(sites, surface)
    merged = merge_sites(lifted, max(pitch / MERGED, MERGE_DISTANCE))
    mean, std, length = interpolated(merged, vertices, float(np.median(merged.log)), LENGTH_OF_PITCH * pitch, fit)
    p, stiff = significance(lifted, mean, std, np.ones(len(mean), bool))
    value = np.exp(mean)  # the process is of the logarithm
    return MapOnSurface(
        map=SurfaceMap(
            vertices=vertices, faces=faces, value=value, std=value * std, p=p, parameter=parameter, unit=unit
        ),
        stiff=stiff,
        length=length,
        blind_below=blind_width(nearest_distance(lifted.place, vertices)),
        reach=_reach(np.abs(curvature)),
    )


def _surface_mesh(
    surface: Surface, nodes: Floats, covered: NDArray[np.int64], columns: int, lines: int
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return vertices (n, 3) [m], triangles (m, 3) of their rows, and the vertices' curvatures (n, 2) [1/m].

    The vertices are the covered nodes (k,) of a grid (lines x columns, 2) [m], laid on the surface where it is known.
    Raises LogError where that leaves no triangle.
    """
    points = surface.uppermost(nodes[covered])
    is_known = np.array([row not in points.unknown for row in range(len(covered))], bool)
    faces = _triangles(covered[is_known], columns, lines)
    if not len(faces):
        raise LogError("the surface is known at none of the map's cells")
    return points.position[is_known], faces, points.curvature[is_known]


def _reach(curvature: Floats) -> float:
    """Return the distance [m] up to which straight distances hold on a surface of curvatures (n, 2) [1/m]."""
    sharpest = float(curvature.max())
    return ARC / sharpest if sharpest > 0 else np.inf


def _triangles(rows: NDArray[np.int64], columns: int, lines: int) -> NDArray[np.int64]:
    """Return two triangles (m, 3) of each cell with four corners among the rows of a grid (lines, columns)."""
    number = np.full(lines * columns, -1)
    number[rows] = np.arange(len(rows))
    grid = number.reshape(lines, columns)
    # The corners of each cell, counter-clockwise.
    a, b, c, d = (part.ravel() for part in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]))
    whole = (np.stack([a, b, c, d]) >= 0).all(axis=0)
    return np.vstack([np.column_stack([a, b, c])[whole], np.column_stack([a, c, d])[whole]]).astype(np.int64)


def surface_map_csv(surface_map: MapOnSurface) -> str:
    """Return one row for each vertex: x, y, z, value, standard deviation, p-value, stiffer than the baseline."""
    drawn_map = surface_map.map
    rows = [f"x_m,y_m,z_m,{drawn_map.parameter},{drawn_map.parameter}_std,p,stiff"]
    numbers = drawn_map.value, drawn_map.std, drawn_map.p, surface_map.stiff
    columns = zip(drawn_map.vertices.tolist(), *numbers, strict=True)
    rows += [
        f"{x:.6f},{y:.6f},{z:.6f},{value:.6g},{std:.4g},{p:.3g},{int(stiff)}"
        for (x, y, z), value, std, p, stiff in columns
    ]
    return "\n".join(rows) + "\n"
