"""A profile from a file of points, and the slope of a curve through them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, is_number

_MIN_POINTS = 4  # of a cubic
_MAX_APEX_SLOPE = 0.25  # of the first chord's slope, a choice: an apex of less slope is smooth, with slope 0
_CHECKS_PER_POINT = 20  # a choice: slopes between two points at which a curve may fall
_ROUNDING = 1e-9  # of the mean slope, a choice: a fall below it is rounding


def read_points(path: Path, unit: float) -> tuple[Floats, Floats]:
    """Return radii and heights (n,) [m] in a CSV file of two columns r, z, in a unit [m].

    A first line without numbers is a heading; lines that begin with # are skipped. Raises ValueError, with file
    and line, on a missing file and on a profile that does not begin at r = 0 and z = 0, whose radii do not grow, whose
    heights fall, or that holds anything but finite numbers.
    """
    radii: list[float] = []
    heights: list[float] = []
    for number, row in enumerate(csv.reader(_profile_lines(path)), start=1):
        place = f"{path}:{number}"
        if not row or not "".join(row).strip() or row[0].lstrip().startswith("#"):
            continue
        try:
            r, z = (float(cell) for cell in row)
        except ValueError as error:
            is_heading = not radii and not any(is_number(cell) for cell in row)
            if is_heading:
                continue
            raise ValueError(f"{place}: {','.join(row)!r} is not a radius and a height") from error
        _refuse_point(r, z, radii, heights, place)
        radii.append(r)
        heights.append(z)
    if len(radii) < _MIN_POINTS:
        raise ValueError(f"{path}: a profile needs at least {_MIN_POINTS} points, there are {len(radii)}")
    if heights[-1] == 0:
        raise ValueError(f"{path}: every height is 0: that is the tip 'flat'")
    return np.array(radii) * unit, np.array(heights) * unit


def _profile_lines(path: Path) -> list[str]:
    """Return the lines of a file; raises ValueError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ValueError(f"{path}: cannot read the profile: {reason}") from error


def _refuse_point(r: float, z: float, radii: list[float], heights: list[float], place: str) -> None:
    """Raise ValueError where a point cannot follow those before it."""
    if not (np.isfinite(r) and np.isfinite(z)):
        raise ValueError(f"{place}: ({r}, {z}) is not finite")
    if not radii and (r != 0 or z != 0):
        raise ValueError(f"{place}: the profile must begin at the apex, r = 0 and z = 0, not at ({r:g}, {z:g})")
    if radii and r <= radii[-1]:
        raise ValueError(f"{place}: the radius must grow from line to line: {r:g} after {radii[-1]:g}")
    if heights and z < heights[-1]:
        raise ValueError(f"{place}: the height must not fall: {z:g} after {heights[-1]:g}; the tip would be hollow")


def curve_through(radii: Floats, heights: Floats) -> Any:
    """Return a scipy piecewise cubic through the points: a spline, or a monotone one (PCHIP) where that would dip.

    The spline is more accurate on a drawing of a smooth tip; it overshoots at kinks and on noise, and a tip whose
    height falls does not count.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    spline = CubicSpline(radii, heights)
    if abs(float(spline(0.0, 1))) < _MAX_APEX_SLOPE * heights[1] / radii[1]:
        ends: Any = ((1, 0.0), "not-a-knot")
        spline = CubicSpline(radii, heights, bc_type=ends)
    between = np.linspace(radii[0], radii[-1], _CHECKS_PER_POINT * len(radii))
    dips = float(np.min(spline(between, 1))) < -_ROUNDING * float(heights[-1] / radii[-1])
    return PchipInterpolator(radii, heights) if dips else spline
