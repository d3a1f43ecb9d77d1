"""Skins of specimens: planes, meshes, and what touches make of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import plugin

if TYPE_CHECKING:
    from palpate_surfaces.mesh import Mesh
    from palpate_surfaces.plane import Plane

__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"mesh": ["Mesh"], "plane": ["Plane"]})

__all__ = ["Mesh", "Plane"]


@plugin
def palpate_surfaces() -> dict[str, str]:
    """Surfaces."""
    return {"plane": "palpate_surfaces.plane:Plane", "mesh": "palpate_surfaces.mesh:Mesh"}
