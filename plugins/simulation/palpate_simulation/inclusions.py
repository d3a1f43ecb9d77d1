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
# 1.1 % for r = 2.5 mm. The fit c = 1.327 (r/5 mm)^2.043 (1 + t/18.77 mm)^-7.344 is within 4 % of each.
_FITTED_CONTRAST = 1.327
_FITTED_RADIUS = 5e-3  # [m]
_RADIUS_EXPONENT = 2.043
_DECAY_DEPTH = 18.77e-3  # [m]
_DEPTH_EXPONENT = 7.344
_FITTED_RATIO = 5.3  # stiffness of the sphere of these finite elements over that of the matrix
_ESHELBY = 0.4  # share of an incompressible sphere's own stiffness in the strain around it (Eshelby 1957)
_BLUR_PER_DEPTH = 0.4  # of the depth of the body's middle (an assumption)
# Points of the arcs that are drawn: a choice, no chord is off its arc by more than 1 % of the radius.
_ARC_POINTS = 25
_CIRCLE_POINTS = 49
_CAP_POINTS = 13


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
    def _check_image_file(self) -> Self:
        """Return the inclusion; raises ValueError for an image without a file, or a file without an image."""
        if (self.shape == "image") != (self.file is not None):
            raise ValueError('shape = "image" and file belong together')
        if self.shape == "image":
            _ = self._pixels  # read now, so that a wrong file is reported with the table
        return self

    @property
    def contrast_above(self) -> float:
        """Contrast above the middle of the body, where it is largest: `peak`, or that of the fitted sphere.

        With the stiffness ratio k: 1.327 (r/5 mm)^2.043 (1 + depth/18.77 mm)^-7.344 f(k)/f(5.3), where
        f(k) = (k - 1)/(1 + 0.4 (k - 1)) is Eshelby's strain in a sphere.
        """
        if self.peak is not None:
            return self.peak
        strain = (self.stiffness_ratio - 1) / (1 + _ESHELBY * (self.stiffness_ratio - 1))
        fitted_strain = (_FITTED_RATIO - 1) / (1 + _ESHELBY * (_FITTED_RATIO - 1))
        size = (self.radius / _FITTED_RADIUS) ** _RADIUS_EXPONENT
        decay = (1 + self.depth / _DECAY_DEPTH) ** -_DEPTH_EXPONENT
        return float(_FITTED_CONTRAST * size * decay * strain / fitted_strain)

    @cached_property
    def line(self) -> Floats:
        """Centre line of the body in the plane (k, 2) [m]: a point, a segment, or an arc with two legs."""
        if self.shape == "sphere":
            points = np.zeros((1, 2))
        elif self.shape == "cylinder":
            points = np.column_stack([np.array([-0.5, 0.5]) * self.length, np.zeros(2)])
        else:
            # Half a circle that opens towards positive x, and legs as long as its radius.
            angles = np.linspace(np.pi / 2, 3 * np.pi / 2, _ARC_POINTS)
            arc = self.bend * np.column_stack([np.cos(angles), np.sin(angles)])
            upper_leg, lower_leg = [self.bend, self.bend], [self.bend, -self.bend]
            points = np.vstack([upper_leg, arc, lower_leg])
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        rotation = np.array([[cos, sin], [-sin, cos]])  # of rows
        return np.asarray(points @ rotation + np.array(self.place))

    def contrast(self, x: Floats, y: Floats, contact_radius: float) -> Floats:
        """Return the contrast (n,) that a tip with a contact radius [m] feels at x, y (n,) [m]."""
        if self.shape == "image":
            return self._image_contrast(x, y, contact_radius)
        return self.contrast_at(self._distance(x, y), contact_radius)

    def contrast_at(self, distance: Floats, contact_radius: float) -> Floats:
        """Return the contrast (n,) at distances rho (n,) [m] along the skin: peak exp(-rho^2/(2 w^2)).

        w^2 = (r/2)^2 + (a/2)^2 + (0.4 (depth + r))^2, with the contact radius a [m] of the tip.
        """
        variance = (
            (self.radius / 2) ** 2 + (contact_radius / 2) ** 2 + (_BLUR_PER_DEPTH * (self.depth + self.radius)) ** 2
        )
        return np.asarray(self.contrast_above * np.exp(-(distance**2) / (2 * variance)))

    def _distance(self, x: Floats, y: Floats) -> Floats:
        """Return the distance (n,) [m] in the plane from x, y (n,) [m] to the centre line."""
        line = self.line
        if len(line) == 1:
            return np.asarray(np.hypot(x - line[0, 0], y - line[0, 1]))
        distance = np.full(np.shape(x), np.inf)
        for (start_x, start_y), (end_x, end_y) in itertools.pairwise(line):
            dx, dy = x - start_x, y - start_y
            segment_x, segment_y = end_x - start_x, end_y - start_y
            # The nearest point of the segment, as a share of its length.
            share = np.clip((dx * segment_x + dy * segment_y) / (segment_x**2 + segment_y**2), 0.0, 1.0)
            distance = np.minimum(distance, np.hypot(dx - share * segment_x, dy - share * segment_y))
        return distance

    @cached_property
    def _pixels(self) -> Floats:
        """Contrasts (rows, columns) of the image; raises ConfigurationError for a file without them."""
        assert self.file is not None
        try:
            pixels = np.loadtxt(self.file.read_text(encoding="utf-8-sig").splitlines(), delimiter=",", ndmin=2)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.file}: cannot be read as an image of contrasts: {error}") from error
        if min(pixels.shape) < 2 or not np.isfinite(pixels).all() or pixels.min() <= -1:
            raise ConfigurationError(f"{self.file}: an image has 2 x 2 or more finite contrasts above -1")
        return np.asarray(pixels)

    def _image_contrast(self, x: Floats, y: Floats, contact_radius: float) -> Floats:
        """Return the contrast (n,) of the blurred image at x, y (n,) [m], between its pixels; 0 off the image."""
        from scipy.ndimage import gaussian_filter, map_coordinates

        blur = np.hypot(contact_radius / 2, _BLUR_PER_DEPTH * self.depth) / self.pixel  # in pixels
        image = gaussian_filter(self._pixels, blur, mode="constant")
        row_count, column_count = self._pixels.shape
        column = (x - self.place[0]) / self.pixel + (column_count - 1) / 2
        row = (y - self.place[1]) / self.pixel + (row_count - 1) / 2
        contrast: Any = map_coordinates(image, [np.atleast_1d(row), np.atleast_1d(column)], order=1, mode="constant")
        return np.asarray(contrast)

    @property
    def outline(self) -> Floats:
        """Outline of the body seen from above (k, 2) [m], closed."""
        if self.shape == "image":
            half_size = np.array(self._pixels.shape[::-1]) * self.pixel / 2
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
            return np.asarray(corners * half_size + np.array(self.place))
        return rod_outline(self.line, self.radius)


def rod_outline(line: Floats, radius: float) -> Floats:
    """Return the closed outline (k, 2) [m] of a rod with round ends along a line (m, 2); a circle around one point."""
    if len(line) == 1:
        return _arc(line[0], radius, np.linspace(0.0, 2 * np.pi, _CIRCLE_POINTS))
    tangent = np.gradient(line, axis=0)
    directions = np.arctan2(tangent[:, 1], tangent[:, 0])  # [rad]
    left_normal = np.column_stack([-np.sin(directions), np.cos(directions)])
    left = line + radius * left_normal
    right = line - radius * left_normal
    # Along the right side, round the end, back along the left side, round the start.
    half_circle = np.linspace(-np.pi / 2, np.pi / 2, _CAP_POINTS)
    end_cap = _arc(line[-1], radius, directions[-1] + half_circle)
    start_cap = _arc(line[0], radius, directions[0] + np.pi + half_circle)
    return np.vstack([right, end_cap, left[::-1], start_cap, right[:1]])


def _arc(centre: Floats, radius: float, angles: Floats) -> Floats:
    """Return the points (k, 2) [m] of a circle around a centre (2,) at angles (k,) [rad] from the x axis."""
    return np.asarray(centre + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
