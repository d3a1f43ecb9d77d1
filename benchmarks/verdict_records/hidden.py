"""Fifteen ways in which a record is wrong and shows nothing of it; written down before the first run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from verdict_records.contact import Specimen
from verdict_records.sizes import Readings, readings


@dataclass(frozen=True)
class Hidden:
    """One kind: what the rig reads of a specimen, and the facts by which it is listed, of which one is enough."""

    name: str
    make: Callable[[Specimen], Readings]
    facts: tuple[str, ...]
    rigs: tuple[str, ...]


def _resized(share: float) -> Callable[[Specimen], Readings]:
    return lambda s: readings(replace(s, rig=replace(s.rig, size=share * s.rig.size)))


def _scaled(force: float = 1.0, depth: float = 1.0) -> Callable[[Specimen], Readings]:
    def make(s: Specimen) -> Readings:
        found = readings(s)
        return replace(found, force=force * found.force, depth=depth * found.depth)

    return make


def _material(elastic: float, viscous: float) -> Callable[[Specimen], Readings]:
    return lambda s: readings(replace(s, elasticity=elastic * s.elasticity, viscosity=viscous * s.viscosity))


def _poisson(nu: float) -> Callable[[Specimen], Readings]:
    return _material(0.75 / (1 - nu**2), 0.5 / (1 - nu))


def _tilted(degrees: float) -> Callable[[Specimen], Readings]:
    """The tip slides on the skin: it goes in by cos(t) of the way, and the force along its axis is cos(t) of all."""
    share = float(np.cos(np.radians(degrees)))

    def make(s: Specimen) -> Readings:
        force = share * s.force(share * s.travel)
        return Readings(s.time, s.travel, force + s.rig.mass * s.rate_of(s.rate_of(s.travel)))

    return make


def _layer(height: float) -> Callable[[Specimen], Readings]:
    """Under a flat tip of radius R a layer is stiffer by one number (Garcia and Garcia 2018, R/h below 0.5)."""

    def make(s: Specimen) -> Readings:
        b = s.rig.size / height
        share = 1 + 1.133 * b + 1.283 * b**2 + 0.598 * b**3 - 0.291 * b**4
        return _material(share, share)(s)

    return make


def _curved(radius: float) -> Callable[[Specimen], Readings]:
    """Two spheres (Hertz 1882)."""
    return lambda s: readings(replace(s, rig=replace(s.rig, size=1 / (1 / s.rig.size + 1 / radius))))


def _base(share: float) -> Callable[[Specimen], Readings]:
    """A base in series with an elastic material under a flat tip takes a constant share of the way."""
    return lambda s: _material(1 - share, 0.0)(s)


_SPHERES = ("press", "robot", "robot-ramp", "beam")
HIDDEN = (
    Hidden("radius 5 % larger", _resized(1.05), ("indenter.radius", "indenter.curvature_radius"), _SPHERES),
    Hidden("twice the radius", _resized(2.0), ("indenter.radius", "indenter.curvature_radius"), _SPHERES),
    Hidden("flat tip 5 % larger", _resized(1.05), ("indenter.radius",), ("texture", "dma")),
    Hidden("cone 2 degrees steeper", _resized(47 / 45), ("indenter.angle",), ("cone",)),
    Hidden("force 8 % too large", _scaled(force=1.08), ("force_scale",), (*_SPHERES, "texture")),
    Hidden("force 2 % too small", _scaled(force=0.98), ("force_scale",), (*_SPHERES, "cone")),
    Hidden("heights 3 % too large", _scaled(depth=1.03), ("position_scale",), ("press", "texture", "beam")),
    Hidden("Poisson's ratio 0.2", _poisson(0.2), ("poisson",), (*_SPHERES, "texture")),
    Hidden("Poisson's ratio 0.45", _poisson(0.45), ("poisson",), (*_SPHERES, "cone")),
    Hidden("tilted by 5 degrees", _tilted(5), ("level",), ("press", "beam")),
    Hidden("tilted by 20 degrees", _tilted(20), ("level",), ("press", "beam")),
    Hidden("a layer of 22 mm under a flat tip", _layer(22e-3), ("thickness",), ("texture", "dma")),
    Hidden("a layer of 11 mm under a flat tip", _layer(11e-3), ("thickness",), ("texture", "dma")),
    Hidden("a convex skin of 25 mm", _curved(25e-3), ("flat",), ("press", "robot", "robot-ramp")),
    Hidden("a base that takes 5 % under a flat tip", _base(0.05), ("mount",), ("texture",)),
)
