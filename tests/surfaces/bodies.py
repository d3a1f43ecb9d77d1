"""Bodies of triangles whose surface is known by a formula, as files."""

import numpy as np

AXES = np.array([0.03, 0.025, 0.04])  # of the breast phantom: 60 x 50 mm across, 40 mm high


def icosphere(subdivisions, radius=1.0):
    """Vertices and faces of a sphere."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(sphere.vertices), np.array(sphere.faces)


def ellipsoid(subdivisions=4, axes=AXES):
    """Vertices [m] and faces of an ellipsoid."""
    vertices, faces = icosphere(subdivisions)
    return vertices * axes, faces


def half(vertices, faces):
    """The upper half, with one rim."""
    return vertices, faces[(vertices[faces][:, :, 2] >= -1e-9).all(axis=1)]


def sheet(size=0.1, count=21):
    """Vertices [m] and faces of a level square."""
    x = np.linspace(-size / 2, size / 2, count)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    return np.column_stack([grid, np.zeros(len(grid))]), np.vstack(
        [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    )


def write_body(file, vertices, faces, unit=1e-3):
    """Write a body [m] as the format of a file's name says, in its unit; OBJ with all digits. Returns the file."""
    import trimesh

    if file.suffix == ".obj":
        points = [f"v {x!r} {y!r} {z!r}" for x, y, z in (vertices / unit).tolist()]
        corners = [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
        file.write_text("\n".join([*points, *corners]) + "\n")
    else:
        trimesh.Trimesh(vertices / unit, faces, process=False).export(file)
    return file


def ellipsoid_truth(points, axes=AXES):
    """Normals (n, 3) and mean curvatures (n,) [1/m] of an ellipsoid at points (n, 3) of it.

    Source: Goldman 2005, of implicit surfaces.
    """
    gradient = 2 * points / axes**2
    length = np.linalg.norm(gradient, axis=1)
    hessian = 2 / axes**2
    curved = (gradient**2 * hessian).sum(axis=1)
    return gradient / length[:, None], (length**2 * hessian.sum() - curved) / (2 * length**3)
