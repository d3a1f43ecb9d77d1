"""How well surfaces know a body: a mesh of an ellipsoid, registrations by eight touches, and skins of touches alone.

And how much sooner a mesh answers for the places of a motion together than for one after the other.

Run it with: python benchmarks/surfaces.py [REGISTRATIONS]
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from palpate import Floats, surface_points
from palpate_surfaces import Mesh, TouchedSurface
from palpate_surfaces.pose import UncertainPose
from palpate_surfaces.registration import moved, register
from palpate_surfaces.touches import Touches, touches_table

AXES = np.array([0.03, 0.025, 0.04])  # [m]
NOISE = 1e-4  # [m] of a touch
STATED = (1.5e-3, 0.06)  # [m], [rad] to which the pose is known before
SURE = {"position_uncertainty": 1e-9, "rotation_uncertainty": 1e-9, "shape_uncertainty": 0.0}


def body(file: Path, fine: int) -> Path:
    """The upper half of the ellipsoid as an STL in millimetres."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=fine)
    vertices = np.array(sphere.vertices) * AXES
    faces = np.array(sphere.faces)
    upper = faces[(vertices[faces][:, :, 2] >= -1e-9).all(axis=1)]
    trimesh.Trimesh(1e3 * vertices, upper, process=False).export(file)
    return file


def truth(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances (n,), normals (n, 3) and mean curvatures (n,) of the ellipsoid, its top at the origin."""
    own = points + np.array([0.0, 0.0, AXES[2]])
    gradient, hessian = 2 * own / AXES**2, 2 / AXES**2
    length = np.linalg.norm(gradient, axis=1)
    mean = (length**2 * hessian.sum() - (gradient**2 * hessian).sum(axis=1)) / (2 * length**3)
    return (((own / AXES) ** 2).sum(axis=1) - 1) / length, gradient / length[:, None], mean


def angles(a: Floats, b: Floats) -> Floats:
    """(n,) [rad] between unit vectors."""
    return np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))


def meshes(folder: Path) -> None:
    """Position, normal and mean curvature on the body at its true pose."""
    lateral = np.random.default_rng(1).uniform(-0.017, 0.017, (200, 2))
    for fine in (3, 4, 5):
        mesh = Mesh(file=body(folder / f"{fine}.stl", fine), position=(0.0, 0.0, -AXES[2]), **SURE)
        points = surface_points(mesh, lateral)
        off, normal, mean = truth(points.position)
        turned, bent = angles(normal, points.normal), points.curvature.mean(axis=1) / mean - 1
        print(
            f"{len(mesh.body.triangles.faces)} triangles, worst of 200 places: {1e6 * np.abs(off).max():.1f} um, "
            f"{math.degrees(turned.max()):.3f} deg, mean curvature {100 * np.abs(bent).max():.1f} %",
            flush=True,
        )


def at(mesh: Mesh, pose: UncertainPose) -> Mesh:
    """The same mesh at another pose."""
    there = mesh.model_copy()
    vars(there).update(body=mesh.body, pose=pose)
    return there


def touched(mesh: Mesh, lateral: Floats, radius: float, rng: np.random.Generator) -> Touches:
    """Where a sphere that comes down along z meets a mesh, with noise along the normal."""
    centre = np.column_stack([lateral, np.full(len(lateral), 0.01)])
    for _ in range(10):
        points = mesh.nearest(centre)
        centre[:, 2] -= (points.height - radius) / points.normal[:, 2]
    centre[:, 2] += rng.normal(0.0, NOISE, len(centre)) / points.normal[:, 2]
    one = np.ones(len(lateral))
    return Touches(centre - [0.0, 0.0, radius], radius * one, NOISE * one, tuple(map(str, range(len(one)))))


def registrations(folder: Path, count: int) -> None:
    """Eight touches of a body that stands somewhere: errors at twenty places over their uncertainties."""
    mesh = Mesh(
        file=body(folder / "registered.stl", 4),
        position=(0.0, 0.0, -AXES[2]),
        position_uncertainty=STATED[0],
        rotation_uncertainty=STATED[1],
        shape_uncertainty=0.0,
    )
    heights, turns, stds = [], [], []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        true = at(mesh, moved(mesh.pose, rng.normal(0.0, np.repeat(STATED, 3))))
        found = register(mesh, touched(true, rng.uniform(-0.012, 0.012, (8, 2)), 0.005, rng))
        places = true.uppermost(rng.uniform(-0.01, 0.01, (20, 2)))
        points = at(mesh, found.pose).nearest(places.position)
        heights.append(points.height / points.position_std)
        turns.append(angles(points.normal, places.normal) / points.normal_std)
        stds.append([points.position_std.mean(), points.normal_std.mean()])
    position, normal = np.mean(stds, axis=0)
    print(
        f"{count} registrations by 8 touches: height within 1.96 u at {100 * np.mean(np.abs(heights) < 1.96):.0f} %, "
        f"normal within 2.45 u at {100 * np.mean(np.array(turns) < 2.45):.0f} % of places; u {1e3 * position:.3f} mm, "
        f"{math.degrees(normal):.2f} deg",
        flush=True,
    )


def skins(folder: Path, count: int) -> None:
    """A grid of 25 touches of the top: errors at ten places over their uncertainties."""
    grid = np.linspace(-1, 1, 5)
    lateral = np.array([[0.017 * x, 0.0136 * y] for x in grid for y in grid])
    height = AXES[2] * (np.sqrt(1 - ((lateral / AXES[:2]) ** 2).sum(axis=1)) - 1)
    found = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        top = np.column_stack([lateral, height + rng.normal(0.0, NOISE, 25)])
        given = Touches(top, np.zeros(25), np.full(25, NOISE), tuple(map(str, range(25))))
        (folder / "touches.csv").write_text(touches_table(given))
        surface = TouchedSurface(touches=(folder / "touches.csv",))
        points = surface_points(surface, rng.uniform(-0.009, 0.009, (10, 2)))
        off, normal, mean = truth(points.position)
        turned, bent = angles(normal, points.normal), points.curvature.mean(axis=1) / mean - 1
        within = np.abs(off / points.position_std) < 1.96, turned / points.normal_std < 2.45
        stds = (
            points.position_std,
            points.normal_std,
            np.abs(turned),
            points.curvature_std.max(axis=1) / mean,
            np.abs(bent),
        )
        found.append([np.mean(values) for values in (*within, *stds)])
    high, turn, u, u_turn, error, u_bend, bend = np.mean(found, axis=0)
    print(
        f"{count} skins of 25 touches: height within 1.96 u at {100 * high:.0f} %, normal within 2.45 u at "
        f"{100 * turn:.0f} %; u {1e3 * u:.3f} mm, {math.degrees(u_turn):.2f} deg (error {math.degrees(error):.2f}), "
        f"curvature {100 * u_bend:.0f} % (error {100 * bend:.0f})"
    )


def together(folder: Path) -> None:
    """Processor time of places one by one over that of all at once, interleaved; the check of a motion asks for all."""
    mesh = Mesh(file=body(folder / "body.stl", 4), position=(0.0, 0.0, -AXES[2]))
    top = mesh.uppermost(np.random.default_rng(0).uniform(-0.012, 0.012, (1000, 2)))
    places, ratios = top.position - 4e-3 * top.normal, []
    for _ in range(5):
        begin = time.process_time()
        mesh.nearest(places)
        middle = time.process_time()
        for place in places[::10]:
            mesh.nearest(place[None])
        ratios.append(10 * (time.process_time() - middle) / (middle - begin))
    print(f"\n1000 places at once take 1/{np.median(ratios):.0f} of the time of one by one")


def main() -> None:
    """Everything."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with TemporaryDirectory() as name:
        meshes(Path(name))
        together(Path(name))
        skins(Path(name), max(count // 5, 1))
        registrations(Path(name), count)


if __name__ == "__main__":
    main()
