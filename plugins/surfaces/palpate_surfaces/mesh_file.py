"""A file with a mesh, read and checked: one piece, without holes, turned outwards, of the size of a specimen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

FORMATS = (".stl", ".ply", ".obj")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
# Choices.
_MIN_SIZE, _MAX_SIZE = 5e-3, 2.0  # [m] that a specimen is across
_MIN_TRIANGLES = 8
_MERGED_SHARE = 1e-6  # of the body's size, below which vertices are one


def read_mesh(file: Path, unit: str) -> Any:
    """Return the mesh in an STL, PLY or OBJ file of a unit as a `trimesh.Trimesh` [m]; raises ConfigurationError."""
    import trimesh

    if file.suffix.lower() not in FORMATS:
        raise ConfigurationError(f"{file}: a mesh is a file {', '.join(FORMATS)}, not {file.suffix or 'one without'}")
    if not file.is_file():
        raise ConfigurationError(f"{file}: no such file")
    try:
        with file.open("rb") as opened:  # alone: what it refers to, materials and pictures, is not opened
            mesh = trimesh.load_mesh(opened, file_type=file.suffix.lower()[1:], process=False, skip_materials=True)
    except Exception as error:  # any error of its readers on a damaged file
        raise ConfigurationError(f"{file}: cannot be read as a mesh: {type(error).__name__}: {error}") from error
    _check_numbers(file, mesh)
    mesh = _merge_corners(mesh.vertices[mesh.faces].reshape(-1, 3) * UNITS[unit])
    _check_size(file, unit, float(np.ptp(mesh.vertices, axis=0).max()))
    _check_edges(file, mesh)
    _check_holes(file, mesh)
    return mesh


def _check_numbers(file: Path, mesh: Any) -> None:
    """Raise ConfigurationError for too few triangles, a vertex that is missing, and one that is not finite."""
    import trimesh

    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) < _MIN_TRIANGLES:
        count = len(mesh.faces) if isinstance(mesh, trimesh.Trimesh) else 0
        raise ConfigurationError(f"{file}: it has {count} triangles; a surface has at least {_MIN_TRIANGLES}")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ConfigurationError(f"{file}: a triangle has a vertex that the file has not: it has {len(mesh.vertices)}")
    if not np.isfinite(mesh.vertices).all():
        row = int(np.argwhere(~np.isfinite(mesh.vertices))[0][0])
        raise ConfigurationError(f"{file}: vertex {row + 1} of {len(mesh.vertices)} is not a finite number")


def _merge_corners(corners: Floats) -> Any:
    """Return the mesh of triangles' corners (3 n, 3) [m], in which corners at one place are one vertex.

    Triangles that are a line then are left out. Vertices are numbered in the order of their coordinates, so that each
    file that holds a body gives the same mesh.
    """
    import trimesh

    step = _MERGED_SHARE * float(np.ptp(corners, axis=0).max()) or 1.0
    _, first_corners, vertex_index = np.unique(np.round(corners / step), axis=0, return_index=True, return_inverse=True)
    faces = vertex_index.reshape(-1, 3)
    has_three_vertices = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return trimesh.Trimesh(corners[first_corners], faces[has_three_vertices], process=False)


def _check_size(file: Path, unit: str, size: float) -> None:
    """Raise ConfigurationError for a size [m] that no specimen has, with the unit in which it would be one."""
    if _MIN_SIZE <= size <= _MAX_SIZE:
        return
    plausible_units = [
        other for other, factor in UNITS.items() if _MIN_SIZE <= size / UNITS[unit] * factor <= _MAX_SIZE
    ]
    hint = f'; did you mean unit = "{plausible_units[-1]}"?' if plausible_units else ""
    raise ConfigurationError(
        f'{file}: read in unit = "{unit}" the body is {size:.3g} m across, and a specimen is between {_MIN_SIZE:g} and '
        f"{_MAX_SIZE:g} m{hint}"
    )


def _check_edges(file: Path, mesh: Any) -> None:
    """Raise ConfigurationError for edges of three triangles, more than one piece, and triangles turned inwards."""
    _, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    if (counts > 2).any():
        raise ConfigurationError(f"{file}: {(counts > 2).sum()} edges belong to more than two triangles")
    if (pieces := len(_components(mesh.edges_sorted, len(mesh.vertices)))) > 1:
        raise ConfigurationError(f"{file}: it is made of {pieces} separate pieces; a surface is one")
    # Two triangles that are turned alike pass their common edge in opposite directions.
    if repeated_edges := len(mesh.edges) - len(np.unique(mesh.edges, axis=0)):
        raise ConfigurationError(
            f"{file}: at {repeated_edges} edges two neighbouring triangles are turned against one another, so that "
            "some of its normals point inwards"
        )


def _check_holes(file: Path, mesh: Any) -> None:
    """Raise ConfigurationError for rims of a mesh, except the one of an open mesh where the body was cut off."""
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    rims = rims_of(edges[counts == 1], mesh.vertices)
    perimeters = [float(np.linalg.norm(np.diff(rim, axis=1)[:, 0], axis=1).sum()) for rim in rims]
    # The cut goes round the body, and is at least as long as the body.
    size = float(np.ptp(mesh.vertices, axis=0).max())
    cut = int(np.argmax(perimeters)) if perimeters and max(perimeters) >= size else None
    holes = [(perimeters[i], rims[i].mean(axis=(0, 1))) for i in range(len(rims)) if i != cut]
    if holes:
        perimeter, middle = max(holes, key=lambda hole: hole[0])
        coordinates = ", ".join(f"{1e3 * coordinate:.1f}" for coordinate in middle)
        raise ConfigurationError(
            f"{file}: {len(holes)} hole{'s' * (len(holes) > 1)} in the mesh; the largest is {1e3 * perimeter:.1f} mm "
            f"around, at ({coordinates}) mm of its own frame: close it"
        )


def _components(edges: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Return the vertices of each connected piece of edges (n, 2); vertices without an edge are left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, labels = connected_components(links, directed=False)
    vertices = np.unique(edges)
    return [vertices[labels[vertices] == label] for label in np.unique(labels[vertices])]


def rims_of(edges: NDArray[np.int64], vertices: Floats) -> list[Floats]:
    """Return each rim as its edges (m, 2, 3) [m], of edges (n, 2) that belong to one triangle only."""
    if not len(edges):
        return []
    return [vertices[edges[np.isin(edges[:, 0], piece)]] for piece in _components(edges, len(vertices))]
