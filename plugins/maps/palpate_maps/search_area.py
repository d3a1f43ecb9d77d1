"""The area of a search: what is given, or the workspace, as far as the surface is known and no device refuses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, KnowsTruth, Setpoint, surface_of, surface_points
from palpate_engine import Pipeline, ask_devices

from palpate_maps.grid_cells import Cells, thinned
from palpate_maps.search_skin import SearchSkin, skin_share, tips_on
from palpate_maps.stiffness_field import distances

Box = tuple[float, float, float, float]  # x0, x1, y0, y1 [m]

_SPECIMEN = "the specimen"
# Choices: how far a search goes, and how finely.
_BEYOND = 30e-3  # [m] that a search goes beyond what is known, at most, where only the rig knows the specimen
_STEP = 1.5e-3  # [m] between places that are asked for
_MAX_STEPS = 54  # of them along each side
_MAX_PLACES = 400  # about, of virtual lumps that an exam may exclude: a choice of computing time
_ROUNDING = 1e-9  # [m] by which a place may lie outside of a border
# A choice of time: most places that a device takes, it takes together.
_FEW = 8  # places that are asked for one by one, where one of them is refused


@dataclass(frozen=True)
class Area:
    """Places that may be visited: those of a grid that nothing refuses."""

    nodes: Floats  # (m, 2) [m], or (m, 3) on a surface
    cells: Cells  # (m, 2) column and row of each in the grid
    bounded_by: str  # what bounds it, in words
    _allows: Callable[[Floats], NDArray[np.bool_]]
    share: float = 1.0  # of its grid that may be visited; over a surface, of the skin
    skin: SearchSkin | None = None  # at the nodes, over a surface

    @property
    def places(self) -> tuple[Floats, Floats]:
        """Some of its nodes (m, k) [m], evenly, and the area (m,) that each stands for, relative."""
        stride = math.ceil(math.sqrt(len(self.nodes) / _MAX_PLACES))
        rows = thinned(self.cells, (stride, stride))
        return self.nodes[rows], np.ones(len(rows)) if self.skin is None else self.skin.stretch[rows]

    def allows(self, places: Floats) -> NDArray[np.bool_]:
        """Return True (n,) for the places (n, 2) [m] that may be visited."""
        return self._allows(places)

    def lift(self, places: Floats) -> Floats:
        """Return places (n, 2) [m] as they are, or on the surface (n, 3).

        Beyond what is known of the surface, where the middle of a fitted lump may lie, a place is as high as the
        nearest node.
        """
        if self.skin is None:
            return places
        unknown = sorted(self.skin.surface.uppermost(places).unknown)
        nearest = np.argmin(distances(places[unknown], self.nodes[:, :2]), axis=1)
        known = np.delete(np.arange(len(places)), unknown)
        lifted = np.column_stack([places, np.zeros(len(places))])
        lifted[unknown, 2] = self.nodes[nearest, 2]
        lifted[known] = surface_points(self.skin.surface, places[known]).position
        return lifted


def area_of(pipeline: Pipeline, motion: Any, known: Floats, given: Box | None) -> Area:
    """Return the area given; else the workspace, else the simulated specimen, else where it was palpated (n, 2) [m].

    Inside it, only places that the workspace and every device allow at the deepest of the motion's press, over a
    surface along its normal. `motion` is that of the run, `known` (n, 2) [m] are the places that it palpated.
    """
    box, bounded_by = _box_of(pipeline, known, given)
    surface = surface_of(motion)
    allows = _AllowedPlaces(pipeline, motion, box)

    def skin_at(place: Floats) -> Floats:
        """Return places (n, 3) [m] on the skin below places (n, 2) [m]."""
        if surface is not None:
            return surface_points(surface, place).position
        # Without a surface, the nominal height at the first place counts.
        return np.column_stack([place, motion.surface.at(*known[:1].T)[0]])

    # The nodes of a grid over the box that may be visited.
    grid, cells = _grid(box)
    allowed = allows(grid)
    if not allowed.any():
        raise ConfigurationError(_why_nothing(pipeline, box, bounded_by, skin_at))
    # Beyond a specimen there is nothing to visit, so that all of its grid may be visited.
    unbounded = bounded_by == _SPECIMEN
    if surface is None:
        nodes = grid[allowed]
        share = 1.0 if unbounded else len(nodes) / len(grid)
        return Area(nodes=nodes, cells=cells[allowed], bounded_by=bounded_by, _allows=allows, share=share)
    # Over a surface the nodes are laid on it, and shares are those of its area.
    points = surface.uppermost(grid)
    share = skin_share(points, allowed, 0.0 if unbounded else 1.0)
    skin = SearchSkin.at(surface, points, allowed)
    return Area(
        nodes=points.position[allowed],
        cells=cells[allowed],
        bounded_by=bounded_by,
        _allows=allows,
        share=share,
        skin=skin,
    )


@dataclass(frozen=True)
class _AllowedPlaces:
    """The rule of an area: inside its box and the workspace, and refused by no device, at the deepest of a press."""

    pipeline: Pipeline
    motion: Any
    box: Box

    def __call__(self, places: Floats) -> NDArray[np.bool_]:
        """Return True (n,) for the places (n, 2) [m] that may be visited."""
        # Inside the box of the area.
        x, y = places.T
        x0, x1, y0, y1 = self.box
        inside = _between(x, x0, x1) & _between(y, y0, y1)
        # The tips at the deepest of the press, along the normal of a surface.
        surface = surface_of(self.motion)
        deepest = self.motion.press.bias + self.motion.press.amplitude
        if surface is None:
            tips = _still(np.column_stack([x, y, self.motion.surface.at(x, y)[0] - deepest]))
        else:
            tips, refused = tips_on(surface.uppermost(places), deepest)
            inside &= ~refused
        # The workspace, then the devices.
        limits = self.pipeline.safety
        if limits is not None:
            for axis, values in enumerate(tips.position.T):
                inside &= _between(values, limits.low[axis], limits.high[axis])
        for rows in _refused(self.pipeline, tips, np.flatnonzero(inside)):
            inside[rows] = False
        return np.asarray(inside)


def _between(values: Floats, low: float, high: float) -> NDArray[np.bool_]:
    """Return True (n,) for the coordinates [m] between two, but for rounding."""
    return (values >= low - _ROUNDING) & (values <= high + _ROUNDING)


def _box_of(pipeline: Pipeline, places: Floats, stated_box: Box | None) -> tuple[Box, str]:
    """Return the box of the area, and what bounds it, in words; raises ConfigurationError where the one given is
    empty."""
    if stated_box is not None:
        x0, x1, y0, y1 = stated_box
        if not (x1 > x0 and y1 > y0):
            text = f"{1e3 * x0:g} to {1e3 * x1:g} mm, {1e3 * y0:g} to {1e3 * y1:g} mm"
            raise ConfigurationError(f"--area: {text} is empty: each axis goes from the lower to the higher coordinate")
        return stated_box, "--area"
    low, high = places.min(axis=0), places.max(axis=0)
    if any(isinstance(device, KnowsTruth) for device in pipeline.devices.values()):
        return (low[0] - _BEYOND, high[0] + _BEYOND, low[1] - _BEYOND, high[1] + _BEYOND), _SPECIMEN
    if (limits := pipeline.safety) is not None:
        return (limits.low[0], limits.high[0], limits.low[1], limits.high[1]), "the workspace"
    return (low[0], high[0], low[1], high[1]), "what was palpated; --area extends it"


def _still(places: Floats) -> Setpoint:
    """Return a tip at rest at places (n, 3) [m]."""
    return Setpoint(places, np.zeros((len(places), 3)), np.ones(len(places), bool))


def _why_nothing(pipeline: Pipeline, box: Box, bounded_by: str, skin_at: Callable[[Floats], Floats]) -> str:
    """Return the reason that no place of a box may be palpated: the limits, the surface, or the device, of its
    middle."""
    x0, x1, y0, y1 = box
    text = f"{1e3 * x0:g} to {1e3 * x1:g} mm, {1e3 * y0:g} to {1e3 * y1:g} mm"
    name = "--area" if bounded_by == "--area" else f"the area, {bounded_by}"
    limits = pipeline.safety
    if limits is not None:
        is_beside = x1 < limits.low[0] or x0 > limits.high[0]
        if is_beside or y1 < limits.low[1] or y0 > limits.high[1]:
            low, high = 1e3 * np.array(limits.low), 1e3 * np.array(limits.high)
            workspace = f"x {low[0]:g} to {high[0]:g} mm, y {low[1]:g} to {high[1]:g} mm"
            return f"{name}: {text} lies outside of the workspace of [safety], {workspace}"
    # Inside of the workspace it is a device that refuses its middle, or the depth of the press.
    try:
        ask_devices(pipeline.devices, _still(skin_at(np.array([[(x0 + x1) / 2, (y0 + y1) / 2]]))))
    except ConfigurationError as error:
        return f"{name}: {text}: nothing in it may be palpated: {error}"
    return f"{name}: {text}: nothing in it may be palpated as deep as the press goes"


def _refused(pipeline: Pipeline, tips: Setpoint, rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Return, of rows of tips (n,), those that a device refuses; what it takes together is not asked one by one."""
    if not len(rows):
        return
    try:
        turned = None if tips.rotation is None else tips.rotation[rows]
        ask_devices(pipeline.devices, replace(_still(tips.position[rows]), rotation=turned))
    except ConfigurationError:
        if len(rows) == 1:
            yield rows
            return
        # Halves of many, each of few.
        for part in np.array_split(rows, 2 if len(rows) > _FEW else len(rows)):
            yield from _refused(pipeline, tips, part)


def _grid(box: Box) -> tuple[Floats, Cells]:
    """Return the nodes (m, 2) [m] of a box, and the column and row of each.

    The number of steps is even, so that every second node reaches the borders, too.
    """
    x0, x1, y0, y1 = box
    x, y = _coordinates(x0, x1), _coordinates(y0, y1)
    columns, rows = np.meshgrid(np.arange(len(x)), np.arange(len(y)))
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return nodes, np.stack([columns, rows], axis=-1).reshape(-1, 2)


def _coordinates(low: float, high: float) -> Floats:
    """Return coordinates [m] of nodes from one to another, with an even number of steps."""
    half = min(round((high - low) / _STEP / 2), _MAX_STEPS // 2)
    return np.linspace(low, high, 2 * half + 1)
