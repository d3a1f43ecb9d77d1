"""A file with a mesh, read and checked: one piece, without holes, turned outwards, of the size of a specimen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats

FORMATS = (".stl", ".ply", ".obj")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_SMALLEST, _LARGEST = 5e-3, 2.0  # [m] that a specimen is across
_FEWEST = 8  # triangles
_MERGED = 1e-6  # of its size, below which vertices are one


def read_mesh(file: Path, unit: str) -> Any:
    """Return the mesh in an STL, PLY or OBJ file [m] as a `trimesh.Trimesh`; raises ConfigurationError with what is
    wrong."""
    import trimesh

    if file.suffix.lower() not in FORMATS:
        raise ConfigurationError(f"{file}: a mesh is a file {', '.join(FORMATS)}, not {file.suffix or 'one without'}")
    if not file.is_file():
        raise ConfigurationError(f"{file}: no such file")
    try:
        with file.open("rb") as opened:  # alone: what it refers to, materials and pictures, is not opened
            mesh = trimesh.load_mesh(opened, file_type=file.suffix.lower()[1:], process=False, skip_materials=True)
    except Exception as error:  # whatever its readers raise on a damaged file
        raise ConfigurationError(f"{file}: cannot be read as a mesh: {type(error).__name__}: {error}") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) < _FEWEST:
        count = len(mesh.faces) if isinstance(mesh, trimesh.Trimesh) else 0
        raise ConfigurationError(f"{file}: it has {count} triangles; a surface has at least {_FEWEST}")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ConfigurationError(f"{file}: a triangle has a vertex that the file has not: it has {len(mesh.vertices)}")
    if not np.isfinite(mesh.vertices).all():
        row = int(np.argwhere(~np.isfinite(mesh.vertices))[0][0])
        raise ConfigurationError(f"{file}: vertex {row + 1} of {len(mesh.vertices)} is not a finite number")
    mesh = _merged(mesh.vertices[mesh.faces].reshape(-1, 3) * UNITS[unit])
    _check_size(file, unit, float(np.ptp(mesh.vertices, axis=0).max()))
    _check_edges(file, mesh)
    return mesh


def _merged(corners: Floats) -> Any:
    """The mesh of triangles' corners (3 n, 3), in which corners at one place are one vertex and no triangle is a line.

    Vertices are numbered in the order of their coordinates, so that each file that holds a body gives the same mesh.
    """
    import trimesh

    step = _MERGED * float(np.ptp(corners, axis=0).max()) or 1.0
    _, first, place = np.unique(np.round(corners / step), axis=0, return_index=True, return_inverse=True)
    faces = place.reshape(-1, 3)
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return trimesh.Trimesh(corners[first], faces[proper], process=False)


def _check_size(file: Path, unit: str, size: float) -> None:
    if _SMALLEST <= size <= _LARGEST:
        return
    meant = [other for other, factor in UNITS.items() if _SMALLEST <= size / UNITS[unit] * factor <= _LARGEST]
    hint = f'; did you mean unit = "{meant[-1]}"?' if meant else ""
    raise ConfigurationError(
        f'{file}: read in unit = "{unit}" the body is {size:.3g} m across, and a specimen is between {_SMALLEST:g} and '
        f"{_LARGEST:g} m{hint}"
    )


def _check_edges(file: Path, mesh: Any) -> None:
    """Raise ConfigurationError for more than one piece, for edges of three triangles, and for holes."""
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    if (counts > 2).any():
        raise ConfigurationError(f"{file}: {(counts > 2).sum()} edges belong to more than two triangles")
    if (pieces := len(_components(mesh.edges_sorted, len(mesh.vertices)))) > 1:
        raise ConfigurationError(f"{file}: it is made of {pieces} separate pieces; a surface is one")
    if turned := len(mesh.edges) - len(np.unique(mesh.edges, axis=0)):
        raise ConfigurationError(
            f"{file}: at {turned} edges two neighbouring triangles are turned against one another, so that some of its "
            "normals point inwards"
        )
    rims = rims_of(edges[counts == 1], mesh.vertices)
    around = [float(np.linalg.norm(np.diff(rim, axis=1)[:, 0], axis=1).sum()) for rim in rims]
    # What is not closed may have the one rim where it was cut off: that goes round the body, and is as long as it.
    size = float(np.ptp(mesh.vertices, axis=0).max())
    rim = int(np.argmax(around)) if around and max(around) >= size else -1
    holes = [(length, edge.mean(axis=(0, 1))) for i, (length, edge) in enumerate(zip(around, rims)) if i != rim]
    if holes:
        length, place = max(holes, key=lambda hole: hole[0])
        where = ", ".join(f"{1e3 * value:.1f}" for value in place)
        raise ConfigurationError(
            f"{file}: {len(holes)} hole{'s' * (len(holes) > 1)} in the mesh; the largest is {1e3 * length:.1f} mm "
            f"around, at ({where}) mm of its own frame: close it"
        )


def _components(edges: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Return the vertices of each piece that edges (n, 2) hold together; vertices without an edge are left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, labels = connected_components(links, directed=False)
    used = np.unique(edges)
    return [used[labels[used] == label] for label in np.unique(labels[used])]


def rims_of(edges: NDArray[np.int64], vertices: Floats) -> list[Floats]:
    """Return each rim as its edges (m, 2, 3) [m], of edges (n, 2) that belong to one triangle only."""
    if not len(edges):
        return []
    return [vertices[edges[np.isin(edges[:, 0], piece)]] for piece in _components(edges, len(vertices))]
