"""Skins of specimens: planes, meshes, and what touches make of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_surfaces.half_ellipsoid import HalfEllipsoid as HalfEllipsoid
    from palpate_surfaces.mesh import Mesh as Mesh
    from palpate_surfaces.plane import Plane as Plane
    from palpate_surfaces.touched_surface import TouchedSurface as TouchedSurface


@plugin
def palpate_surfaces() -> dict[str, str]:
    """Return the surfaces by their types."""
    return {
        "plane": "palpate_surfaces.plane:Plane",
        "half-ellipsoid": "palpate_surfaces.half_ellipsoid:HalfEllipsoid",
        "mesh": "palpate_surfaces.mesh:Mesh",
        "touched": "palpate_surfaces.touched_surface:TouchedSurface",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands that register a mesh."""
    return {
        "calibrate surface": Command(
            "palpate_surfaces.surface_command:surface", "Register a mesh by touches.", "hardware"
        ),
        "calibrate touches": Command(
            "palpate_surfaces.touches_command:touches", "The touches of runs as a table.", "hardware"
        ),
    }


__getattr__, __all__ = lazy_names(__name__, *palpate_surfaces().values())
