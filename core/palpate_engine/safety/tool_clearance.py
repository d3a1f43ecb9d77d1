"""The tool above its tip against a surface that it palpates: a capsule, and how far it stays from the skin."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from palpate.errors import ConfigurationError
from palpate.parts import Settings
from palpate.surface import Surface, surface_points
from palpate.trajectory import Setpoint
from palpate.units import Depth
from palpate.vectors import Floats
from pydantic import Field, model_validator

_CELLS = (
    5e-3,
    0.5e-3,
)  # [m] (0293) within which places of the axis count as one; the smaller where the larger leaves it open
_SPACING = 5e-3  # [m] at most between places along the axis (0293)
_COVERAGE = 2.0  # standard uncertainties of the surface: 95 %


class ToolBody(Settings):
    """A capsule that contains what hangs above the tip: all within `radius` of the tool's axis from `begin` to `end`.

    A motion over a surface is refused where it comes nearer to the skin than two standard uncertainties of that.
    """

    radius: Depth = Field(gt=0, description="radius of the capsule, that of the sensor's or the flange's edge")
    begin: Depth = Field(gt=0, description="from the tip to where the capsule's axis begins")
    end: Depth = Field(gt=0, description="from the tip to where the capsule's axis ends")

    @model_validator(mode="after")
    def _in_order(self) -> ToolBody:
        if self.end <= self.begin:
            raise ValueError(f"the end, {1e3 * self.end:g} mm, is not above the begin, {1e3 * self.begin:g} mm")
        return self


@dataclass(frozen=True, order=True)
class ToolGap:
    """Distance of a tool from a surface, the surface's uncertainty taken off: at least so much, and where."""

    distance: float = math.inf  # [m] negative where the tool is in the skin
    time: float = math.nan  # [s]
    place: tuple[float, ...] = ()  # (3,) [m] of the skin


def tool_clearance(tool: ToolBody, times: Floats, setpoint: Setpoint, surface: Surface) -> ToolGap:
    """Return the least clearance of a tool at setpoints at times (n,) [s]; infinite where it surely touches nothing.

    A distance from a surface changes no faster than the place does: what lies between the places that are asked about
    is nearer by half of the gap at most. Raises ConfigurationError where the surface is not known below the tool.
    """
    axis_heights = np.linspace(tool.begin, tool.end, math.ceil((tool.end - tool.begin) / _SPACING) + 1)
    axes = setpoint.position[:, None] + setpoint.axes[:, None] * axis_heights[:, None]
    rows, gap = np.arange(len(times)), ToolGap()
    for cell in _CELLS:
        # One axis stands for all whose two ends lie in the same cells, whose places differ by its diagonal at most.
        axis_cells = np.round(axes[rows][:, [0, -1]].reshape(len(rows), 6) / cell)  # x, y and z of both ends
        _, first, cells = np.unique(axis_cells, axis=0, return_index=True, return_inverse=True)
        distance, place = _distances(axes[rows[first]], surface)
        distance -= tool.radius + math.sqrt(3.0) * cell
        may_touch = distance <= 0.0
        if not may_touch.any():
            return ToolGap()
        worst = int(np.argmin(distance))
        gap = ToolGap(float(distance[worst]), float(times[rows[first[worst]]]), tuple(place[worst].tolist()))
        rows = rows[may_touch[cells.ravel()]]
    return gap


def _distances(axes: Floats, surface: Surface) -> tuple[Floats, Floats]:
    """Return the least distance (n,) [m] of axes, as places (n, k, 3) along each, from a surface, and the place (n, 3)
    there."""
    try:
        points = surface_points(surface, axes.reshape(-1, 3))
    except ConfigurationError as error:
        raise ConfigurationError(f"[safety] tool: whether it is clear of the surface is not known: {error}") from error
    count = axes.shape[:2]
    distance = (points.height - _COVERAGE * points.position_std).reshape(count)
    # Between two places at a gap g the distance is at least (d1 + d2 - g)/2.
    gap = np.linalg.norm(axes[:, 1:] - axes[:, :-1], axis=2)
    between = np.minimum(
        0.5 * (distance[:, 1:] + distance[:, :-1] - gap), np.minimum(distance[:, 1:], distance[:, :-1])
    )
    nearest = np.argmin(distance, axis=1)
    return between.min(axis=1), points.position.reshape(*count, 3)[np.arange(count[0]), nearest]
