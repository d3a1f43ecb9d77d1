"""Bodies below the skin of a simulated specimen, as a tip feels them from above."""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from palpate import Angle, ConfigurationError, Floats, InputFile, Length, Settings
from pydantic import Field, model_validator

# On-axis contrast of a sphere of radius r whose top is t below the skin, stiffness ratio 5.3, felt by a sphere of 5 mm
# at 4 mm: finite elements give 63, 32.5, 17, 9.8, 4.5 % for r = 5 mm and t = 2, 4, 6, 8, 11 mm, and 15, 8.1, 4.2, 2.3,
# 1.1 % for r = 2.5 mm. The expression below, fitted to them, is within 4 % of each.
_SCALE, _RADIUS, _GROWTH = 1.327, 5e-3, 2.043
_REACH, _DECAY = 18.77e-3, 7.344
_ESHELBY = 0.4  # share of an incompressible sphere's own stiffness in the strain around it
_FITTED_RATIO = 5.3
_BLUR = 0.4  # of the depth of its middle


class Inclusion(Settings):
    """A body of another stiffness below the skin, felt as a contrast c(x, y): E = E0 (1 + c).

    c = peak exp(-rho^2/(2 w^2)), rho the distance in the plane to the body's centre line (a point for a sphere, a
    segment for a cylinder, a U for a horseshoe), w^2 = (r/2)^2 + (a/2)^2 + (0.4 (depth + r))^2 the blur by its own
    radius r, the contact radius a, and its depth. The peak follows from finite elements of a sphere, with the stiffness
    ratio k through Eshelby's strain in an incompressible sphere, (k - 1)/(1 + 0.4 (k - 1)); or it is given. The width
    is an assumption, not a computation. An image gives c directly, blurred by the same w with r = 0.
    """

    shape: Literal["sphere", "cylinder", "horseshoe", "image"] = Field(description="what it is")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="its centre [x, y]")
    depth: Length = Field(default=0.004, ge=0, description="depth of its top below the skin")
    radius: Length = Field(default=0.005, gt=0, description="radius of the sphere, or of the rod that it is made of")
    length: Length = Field(default=0.02, gt=0, description="length of a cylinder")
    bend: Length = Field(default=0.008, gt=0, description="radius of a horseshoe's arc")
    angle: Angle = Field(
        default=0.0, description="direction of a cylinder, or of a horseshoe's opening, from the x axis"
    )
    stiffness_ratio: float = Field(
        default=_FITTED_RATIO, gt=0, allow_inf_nan=False, description="its stiffness, relative to the matrix"
    )
    peak: float | None = Field(
        default=None, gt=-1, allow_inf_nan=False, description="contrast above its middle; replaces the estimate"
    )
    file: InputFile | None = Field(default=None, description="image of contrasts: CSV, rows from low to high y")
    pixel: Length = Field(default=0.001, gt=0, description="size of an image's pixel")

    @model_validator(mode="after")
    def _image_has_a_file(self) -> Self:
        if (self.shape == "image") != (self.file is not None):
            raise ValueError('shape = "image" and file belong together')
        if self.shape == "image":
            _ = self._pixels
        return self

    @property
    def contrast_above(self) -> float:
        """Contrast on its axis."""
        if self.peak is not None:
            return self.peak
        body = (self.stiffness_ratio - 1) / (1 + _ESHELBY * (self.stiffness_ratio - 1))
        fitted = (_FITTED_RATIO - 1) / (1 + _ESHELBY * (_FITTED_RATIO - 1))
        size = (self.radius / _RADIUS) ** _GROWTH
        return float(_SCALE * size * (1 + self.depth / _REACH) ** -_DECAY * body / fitted)

    @cached_property
    def line(self) -> Floats:
        """Its centre line in the plane (k, 2) [m]."""
        if self.shape == "sphere":
            points = np.zeros((1, 2))
        elif self.shape == "cylinder":
            points = np.column_stack([np.array([-0.5, 0.5]) * self.length, np.zeros(2)])
        else:
            arc = np.linspace(np.pi / 2, 3 * np.pi / 2, 25)
            bow = self.bend * np.column_stack([np.cos(arc), np.sin(arc)])
            legs = [[self.bend, self.bend], [self.bend, -self.bend]]
            points = np.vstack([legs[0], bow, legs[1]])
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]) + np.array(self.place))

    def contrast(self, x: Floats, y: Floats, contact_radius: float) -> Floats:
        """Contrast (n,) that a tip with a contact radius [m] feels at x, y (n,) [m]."""
        if self.shape == "image":
            return self._image_contrast(x, y, contact_radius)
        return self.contrast_at(self._distance(x, y), contact_radius)

    def contrast_at(self, distance: Floats, contact_radius: float) -> Floats:
        """Contrast (n,) that a tip with a contact radius [m] feels at distances (n,) [m] along the skin."""
        width = (self.radius / 2) ** 2 + (contact_radius / 2) ** 2 + (_BLUR * (self.depth + self.radius)) ** 2
        return np.asarray(self.contrast_above * np.exp(-(distance**2) / (2 * width)))

    def _distance(self, x: Floats, y: Floats) -> Floats:
        """Distance (n,) [m] in the plane to the centre line."""
        line = self.line
        if len(line) == 1:
            return np.asarray(np.hypot(x - line[0, 0], y - line[0, 1]))
        nearest = np.full(np.shape(x), np.inf)
        for (ax, ay), (bx, by) in itertools.pairwise(line):
            dx, dy, way_x, way_y = x - ax, y - ay, bx - ax, by - ay
            along = np.clip((dx * way_x + dy * way_y) / (way_x**2 + way_y**2), 0.0, 1.0)
            nearest = np.minimum(nearest, np.hypot(dx - along * way_x, dy - along * way_y))
        return nearest

    @cached_property
    def _pixels(self) -> Floats:
        assert self.file is not None
        try:
            pixels = np.loadtxt(self.file.read_text(encoding="utf-8-sig").splitlines(), delimiter=",", ndmin=2)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.file}: cannot be read as an image of contrasts: {error}") from error
        if min(pixels.shape) < 2 or not np.isfinite(pixels).all() or pixels.min() <= -1:
            raise ConfigurationError(f"{self.file}: an image has 2 x 2 or more finite contrasts above -1")
        return np.asarray(pixels)

    def _image_contrast(self, x: Floats, y: Floats, contact_radius: float) -> Floats:
        from scipy.ndimage import gaussian_filter, map_coordinates

        blur = np.hypot(contact_radius / 2, _BLUR * self.depth) / self.pixel
        image = gaussian_filter(self._pixels, blur, mode="constant")
        rows, columns = self._pixels.shape[0], self._pixels.shape[1]
        column = (x - self.place[0]) / self.pixel + (columns - 1) / 2
        row = (y - self.place[1]) / self.pixel + (rows - 1) / 2
        found: Any = map_coordinates(image, [np.atleast_1d(row), np.atleast_1d(column)], order=1, mode="constant")
        return np.asarray(found)

    @property
    def outline(self) -> Floats:
        """Its outline seen from above (k, 2) [m], closed."""
        if self.shape == "image":
            half = np.array(self._pixels.shape[::-1]) * self.pixel / 2
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
            return np.asarray(corners * half + np.array(self.place))
        return _around(self.line, self.radius)


def _around(line: Floats, radius: float) -> Floats:
    """Outline (k, 2) of a rod of a radius along a line, with round ends."""
    if len(line) == 1:
        turn = np.linspace(0.0, 2 * np.pi, 49)
        return np.asarray(line[0] + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
    way = np.gradient(line, axis=0)
    angles = np.arctan2(way[:, 1], way[:, 0])
    left = line + radius * np.column_stack([-np.sin(angles), np.cos(angles)])
    right = line - radius * np.column_stack([-np.sin(angles), np.cos(angles)])
    half = np.linspace(-np.pi / 2, np.pi / 2, 13)

    def cap(end: Floats, angle: float) -> Floats:
        return np.asarray(end + radius * np.column_stack([np.cos(angle + half), np.sin(angle + half)]))

    return np.vstack([right, cap(line[-1], angles[-1]), left[::-1], cap(line[0], angles[0] + np.pi), right[:1]])
