"""A map on a surface as a PLY file: triangles with value, standard deviation and p-value at each vertex, in colours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

_AXES = ("x", "y", "z")
_COLOURS = ("red", "green", "blue")
_HEAD = "ply\nformat binary_little_endian 1.0\n"
_CORNERS = 3  # of a face
_FACE = np.dtype([("count", "u1"), ("rows", "<i4", (_CORNERS,))])
_COLOUR_PERCENTILES = (2, 98)  # [%] of the values, between which the colours go (choice)
_MIN_RANGE = 1e-9  # of the lower one, by which the upper one is larger, so that no range is 0 (choice)
_VALUE_COLUMN = 3  # of the properties that are doubles, behind x, y, z


@dataclass(frozen=True)
class SurfaceMap:
    """A parameter on a surface of triangles, at vertices that are near enough to what was palpated."""

    vertices: Floats  # (n, 3) [m] in the work frame
    faces: NDArray[np.int64]  # (m, 3) rows of vertices, counter-clockwise from outside
    value: Floats  # (n,) [SI]
    std: Floats  # (n,) [SI]
    p: Floats  # (n,) chance that a place without a lump is as stiff
    parameter: str
    unit: str  # SI

    @property
    def limits(self) -> tuple[float, float]:
        """The values [SI] between which colours go."""
        low, high = np.percentile(self.value, _COLOUR_PERCENTILES).tolist()
        return low, max(high, low * (1 + _MIN_RANGE))


def write_surface_map(surface_map: SurfaceMap) -> bytes:
    """Return the PLY file: x, y, z [m], NAME, NAME_std and p as properties of each vertex, and its colour (viridis).

    A map has vertices (n, 3) [m], faces, and at each vertex value and standard deviation of a parameter, and the chance
    p that a place without a lump is as stiff.
    """
    import matplotlib

    shown, name = surface_map, surface_map.parameter
    low, high = shown.limits
    colours = matplotlib.colormaps["viridis"](np.clip((shown.value - low) / (high - low), 0.0, 1.0), bytes=True)
    columns = (*_AXES, name, f"{name}_std", "p")
    vertices = np.empty(len(shown.vertices), [(key, "<f8") for key in columns] + [(key, "u1") for key in _COLOURS])
    for key, column in zip(columns, (*shown.vertices.T, shown.value, shown.std, shown.p), strict=True):
        vertices[key] = column
    for i, key in enumerate(_COLOURS):
        vertices[key] = colours[:, i]
    faces = np.empty(len(shown.faces), _FACE)
    faces["count"], faces["rows"] = _CORNERS, shown.faces
    head = [
        f"comment x, y, z [m] in the work frame; {name} and {name}_std [{shown.unit}]",
        f"element vertex {len(vertices)}",
        *(f"property double {key}" for key in columns),
        *(f"property uchar {key}" for key in _COLOURS),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return (_HEAD + "\n".join(head) + "\n").encode() + vertices.tobytes() + faces.tobytes()


def read_surface_map(path: Path) -> SurfaceMap:
    """Return the map in a file that `write_surface_map` made; raises LogError for any other."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return _parse(content)
    except (ValueError, IndexError, KeyError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: is not a map of a surface, or a damaged one: {error}") from error


def _check_triangles(triangles: NDArray[np.int64], positions: Floats) -> None:
    """Raise ValueError where triangles (m, 3) are missing or name unknown vertices, or positions (n, 3) are not
    finite."""
    if not len(triangles) or not np.isfinite(positions).all():
        raise ValueError("it has no triangles, or a vertex that is not a finite number")
    if triangles.min() < 0 or triangles.max() >= len(positions):
        raise ValueError("a triangle names an unknown vertex")


def _parse(content: bytes) -> SurfaceMap:
    """Return the map in the bytes of a PLY file; raises ValueError, IndexError or KeyError for any other content."""
    # The header: counts of vertices and faces, names of the columns, and the unit at the end of a comment.
    head, mark, body = content.partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    if not mark or not head.startswith(_HEAD.encode()):
        raise ValueError("its header is another one")
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element")}
    columns = [line.split()[2] for line in lines if line.startswith("property double")]
    name = columns[_VALUE_COLUMN]
    unit = next(line for line in lines if line.startswith("comment x")).rpartition("[")[2].rstrip("]")
    # The data: vertices, then faces.
    vertex_layout = np.dtype([(key, "<f8") for key in columns] + [(key, "u1") for key in _COLOURS])
    vertex_bytes = counts["vertex"] * vertex_layout.itemsize
    if len(body) != vertex_bytes + counts["face"] * _FACE.itemsize:
        raise ValueError(f"it has {len(body)} bytes of data")
    vertices: Any = np.frombuffer(body, vertex_layout, counts["vertex"])
    faces: Any = np.frombuffer(body, _FACE, counts["face"], offset=vertex_bytes)
    positions = np.column_stack([vertices[key] for key in _AXES])
    triangles = faces["rows"].astype(np.int64)
    _check_triangles(triangles, positions)
    value, std, p = (np.array(vertices[key]) for key in (name, f"{name}_std", "p"))
    return SurfaceMap(positions, triangles, value=value, std=std, p=p, parameter=name, unit=unit)
