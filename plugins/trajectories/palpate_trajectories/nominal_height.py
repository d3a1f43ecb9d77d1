"""The nominal surface that a motion follows: level, a plane, a plane through three touches, or a map of heights."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Angle, ConfigurationError, Floats, InputFile, Length, Settings
from pydantic import Field, model_validator

_MAX_TILT = np.deg2rad(30.0)  # a choice: a steeper skin is a surface, whose normals the tool follows
_MIN_AREA = 1e-6  # [m^2], a choice: twice the area of three touches, below which they are one line
_CUBIC = 3  # degree of the spline in each direction, where the map has points enough
_MIN_ROWS = 3  # and columns of a map: its coordinates, and two points


class NominalHeight(Settings):
    """Height of the skin over the work frame, as far as it is known beforehand.

    A plane z = height + x tan(tilt_x) + y tan(tilt_y), the plane through three touched places, or a map of heights that
    is followed by a bicubic spline, so that velocity and acceleration stay continuous.
    """

    height: Length = Field(default=0.0, description="height at the origin of the work frame")
    tilt_x: Angle = Field(default=0.0, ge=-_MAX_TILT, le=_MAX_TILT, description="rise towards positive x")
    tilt_y: Angle = Field(default=0.0, ge=-_MAX_TILT, le=_MAX_TILT, description="rise towards positive y")
    touches: tuple[tuple[Length, Length, Length], ...] = Field(
        default=(), description="three touched places [x, y, z]; they replace height and tilt"
    )
    file: InputFile | None = Field(
        default=None, description="map of heights: CSV whose first row has the x, first column the y, in metres"
    )

    @model_validator(mode="after")
    def _check_statement(self) -> Any:
        """Raise ValueError for touches that make no plane, and for a file without a map."""
        if self.touches and self.file is not None:
            raise ValueError("give either touches or file")
        if self.touches and len(self.touches) != 3:
            raise ValueError(f"touches needs three places, not {len(self.touches)}")
        if self.touches and abs(self._touched_area) < _MIN_AREA:
            raise ValueError("the three touches lie on one line, or nearly so: no plane goes through them alone")
        if self.file is not None:
            _ = self._spline
        return self

    @property
    def _touched_area(self) -> float:
        """Twice the signed area [m^2] of the triangle of the touches."""
        (ax, ay, _), (bx, by, _), (cx, cy, _) = self.touches
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    @cached_property
    def _plane(self) -> tuple[float, float, float]:
        """Height at the origin [m] and slopes."""
        if not self.touches:
            return self.height, float(np.tan(self.tilt_x)), float(np.tan(self.tilt_y))
        # Three equations z = h + x s_x + y s_y.
        places = np.array(self.touches)
        slope = np.linalg.solve(np.column_stack([np.ones(3), places[:, :2]]), places[:, 2])
        return float(slope[0]), float(slope[1]), float(slope[2])

    @cached_property
    def _spline(self) -> Any:
        """The spline of heights [m] over y and x, through every point of the map."""
        from scipy.interpolate import RectBivariateSpline

        assert self.file is not None
        x, y, heights = read_heights(self.file)
        return RectBivariateSpline(y, x, heights, kx=min(_CUBIC, len(y) - 1), ky=min(_CUBIC, len(x) - 1))

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height [m] and slopes towards x and y, each (n,)."""
        if self.file is not None:
            spline = self._spline
            return spline.ev(y, x), spline.ev(y, x, dy=1), spline.ev(y, x, dx=1)
        height, along_x, along_y = self._plane
        return height + along_x * x + along_y * y, np.full_like(x, along_x), np.full_like(y, along_y)


def read_heights(file: Path) -> tuple[Floats, Floats, Floats]:
    """Return x (nx,), y (ny,) and heights (ny, nx), all [m], of a CSV map; raises ConfigurationError."""
    try:
        table = np.genfromtxt(file.read_text(encoding="utf-8-sig").splitlines(), delimiter=",")
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{file}: cannot be read as a map of heights: {error}") from error
    if table.ndim != 2 or min(table.shape) < _MIN_ROWS:
        raise ConfigurationError(f"{file}: a map of heights has x in its first row, y in its first column, two each")
    x, y, heights = table[0, 1:], table[1:, 0], table[1:, 1:]
    if not (np.isfinite(heights).all() and (np.diff(x) > 0).all() and (np.diff(y) > 0).all()):
        raise ConfigurationError(f"{file}: x and y must increase, and every height be a number")
    return x, y, heights
