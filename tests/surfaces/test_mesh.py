"""The mesh: what it answers, how its pose counts, and what is refused."""

import math
import tracemalloc
from dataclasses import fields

import numpy as np
import pytest
from palpate import ConfigurationError, surface_points
from palpate_engine import load_pipeline
from palpate_engine.pipeline.provenance import run_facts
from palpate_kit.jobs.staging import input_files
from palpate_surfaces import Mesh, Plane
from palpate_testing import check_surface

from tests.surfaces.bodies import AXES, ellipsoid, ellipsoid_truth, half, icosphere, sheet, write_body

SURE = {"position_uncertainty": 1e-9, "rotation_uncertainty": 1e-9, "shape_uncertainty": 0.0}
PLACES = np.array([[0.0, 0.0], [0.01, 0.005], [-0.012, 0.01], [0.018, -0.008]])


@pytest.fixture(scope="module")
def breast(tmp_path_factory):
    """The upper half of an ellipsoid."""
    return write_body(tmp_path_factory.mktemp("breast") / "breast.stl", *half(*ellipsoid()))


@pytest.mark.slow
def test_it_passes_the_checks_of_every_surface(breast):
    check_surface(Mesh(file=breast, position=(0.0, 0.0, -0.04), rotation=(0.1, 0.2, 0.3)), PLACES)


def test_a_level_mesh_is_the_plane(tmp_path):
    places = np.array([[0.01, 0.02, 0.004], [-0.013, 0.0071, -0.002]])
    turn, height = math.radians(10.0), 0.003
    file = write_body(tmp_path / "sheet.obj", *sheet())
    mesh = Mesh(file=file, position=(0.0, 0.0, height), rotation=(0.0, -turn, 0.0), **SURE)
    plane = Plane(height=height, tilt_x=turn)
    for asked in (places, places[:, :2]):
        own, other = surface_points(mesh, asked), surface_points(plane, asked)
        for key in ("position", "normal", "height"):
            np.testing.assert_allclose(getattr(own, key), getattr(other, key), atol=1e-9)
        np.testing.assert_allclose(own.curvature, 0.0, atol=1e-7)


@pytest.mark.slow
def test_normals_and_curvatures_are_those_of_the_body(breast):
    mesh = Mesh(file=breast, position=(0.0, 0.0, -0.04), **SURE)
    points = surface_points(mesh, PLACES)
    own = points.position + np.array([0.0, 0.0, 0.04])
    np.testing.assert_allclose(((own / AXES) ** 2).sum(axis=1), 1.0, atol=1e-4)
    normal, mean = ellipsoid_truth(own)
    angle = np.arccos(np.clip((normal * points.normal).sum(axis=1), -1.0, 1.0))
    assert (angle <= 3 * points.normal_std + 1e-6).all()
    assert (points.normal_std < math.radians(0.3)).all()
    off = points.curvature.mean(axis=1) - mean
    assert (np.abs(off) <= 3 * points.curvature_std.max(axis=1)).all()
    assert (points.curvature_std < 0.05 * mean[:, None]).all()


def test_places_together_are_those_one_by_one(breast):
    """The patches to the bit; places are turned into the mesh's frame together, which rounds otherwise for one."""
    mesh = Mesh(file=breast, position=(0.0, 0.0, -0.04), rotation=(0.02, -0.05, 0.3))
    rng = np.random.default_rng(0)
    top = mesh.uppermost(rng.uniform(-0.012, 0.012, (15, 2)))
    places = top.position + rng.uniform(-0.005, 0.003, (15, 1)) * top.normal
    feet, faces = mesh.body.nearest(mesh.pose.inwards(places))
    patches = mesh.body.patches(feet, faces)
    for field in fields(patches):
        alone = [getattr(mesh.body.patches(foot[None], face[None]), field.name)[0] for foot, face in zip(feet, faces)]
        np.testing.assert_array_equal(getattr(patches, field.name), np.array(alone))
    own, others = mesh.nearest(places), [mesh.nearest(place[None]) for place in places]
    for key in ("position", "normal", "height", "curvature"):
        np.testing.assert_allclose(getattr(own, key), np.concatenate([getattr(o, key) for o in others]), atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "unit"), [("a.ply", 1e-3), ("a.obj", 1e-3), ("a.obj", 1.0), ("a.stl", 1e-2)])
def test_formats_and_units_say_the_same(breast, tmp_path, name, unit):
    other = write_body(tmp_path / name, *half(*ellipsoid()), unit=unit)
    word = {1e-3: "mm", 1e-2: "cm", 1.0: "m"}[unit]
    first, second = (surface_points(Mesh(file=file, unit=own), PLACES) for file, own in ((breast, "mm"), (other, word)))
    np.testing.assert_allclose(second.position, first.position, atol=1e-8)
    np.testing.assert_allclose(second.curvature, first.curvature, rtol=1e-4)


@pytest.mark.slow
def test_a_shift_turns_the_normal_by_itself_over_the_radius(tmp_path):
    """A body of 50 mm radius that may be 1 mm beside its place: 1.1 degrees."""
    file = write_body(tmp_path / "ball.stl", *icosphere(3, 0.05))
    sure = {"rotation_uncertainty": 1e-9, "shape_uncertainty": 0.0}
    points = surface_points(Mesh(file=file, position_uncertainty=1e-3, **sure), np.array([[0.0, 0.0], [0.02, 0.02]]))
    np.testing.assert_allclose(np.degrees(points.normal_std), 1.146, rtol=0.05)
    np.testing.assert_allclose(points.position_std, 1e-3, rtol=0.01)


@pytest.mark.slow
def test_a_turn_about_the_middle_of_a_ball_changes_nothing(tmp_path):
    file = write_body(tmp_path / "ball.stl", *icosphere(3, 0.05))
    sure = {"position_uncertainty": 1e-9, "shape_uncertainty": 0.0}
    points = surface_points(Mesh(file=file, rotation_uncertainty=0.2, **sure), np.array([[0.0, 0.0], [0.02, 0.02]]))
    assert (points.position_std < 1e-4).all()
    assert (points.normal_std < math.radians(0.7)).all()


@pytest.mark.parametrize(
    ("place", "reason"),
    [((0.0, 0.035, -0.045), "beyond the rim of the mesh"), ((0.031, 0.0), "no mesh at this x and y")],
)
def test_what_is_beside_the_body_is_refused(breast, place, reason):
    with pytest.raises(ConfigurationError, match=reason):
        surface_points(Mesh(file=breast, position=(0.0, 0.0, -0.04)), np.array([(0.0,) * len(place), place]))


def test_a_run_knows_its_mesh_by_its_digest(breast, point_pipeline):
    pipeline = load_pipeline(point_pipeline, [f'surface.breast={{type = "mesh", file = "{breast}"}}'])
    assert f"file.{breast}.sha256" in run_facts(pipeline)["inputs"]
    assert breast in list(input_files(pipeline))


def without(faces, vertices, centre, count):
    """Faces but for those nearest to a place."""
    far = np.linalg.norm(vertices[faces].mean(axis=1) - centre, axis=1)
    return faces[np.argsort(far, kind="stable")[count:]]


def bad_bodies():
    vertices, faces = ellipsoid(2)
    upper = half(vertices, faces)
    aside = np.vstack([vertices, vertices + np.array([0.2, 0.0, 0.0])])
    turned = faces.copy()
    turned[:3] = turned[:3, ::-1]
    wing = np.vstack([vertices, [0.05, 0.05, 0.05]]), np.vstack([faces, [[*faces[0][:2], len(vertices)]]])
    return {
        "inwards": (vertices, faces[:, ::-1], r"normals point inwards \(a volume of -1"),
        "downwards": (upper[0], upper[1][:, ::-1], r"point inwards: on average they look along -z"),
        "y up": (
            upper[0][:, [0, 2, 1]] * [1, 1, -1],
            upper[1],
            "look along y of the work frame.*y-up",
        ),
        "y and z exchanged": (upper[0][:, [0, 2, 1]], upper[1], "look along -y of the work frame.*mirrored"),
        "mirrored": (upper[0] * [-1, 1, 1], upper[1], "point inwards: on average they look along -z"),
        "x up": (upper[0][:, [2, 0, 1]], upper[1], "look along x of the work frame"),
        "a hole": (
            vertices,
            without(faces, vertices, [0, 0, 0.04], 5),
            r"1 hole in the mesh; the largest is \d+\.\d mm",
        ),
        "two holes": (
            upper[0],
            without(without(upper[1], upper[0], [0, 0, 0.04], 4), upper[0], [0.02, 0, 0.03], 1),
            "2 holes",
        ),
        "two bodies": (aside, np.vstack([faces, faces + len(vertices)]), "made of 2 separate pieces"),
        "turned": (vertices, turned, r"at \d edges two neighbouring triangles are turned against one another"),
        "a wing": (*wing, "1 edges belong to more than two triangles"),
        "few": (vertices, faces[:3], "it has 3 triangles; a surface has at least 8"),
        "metres": (1e3 * vertices, faces, r'unit = "mm" the body is 80 m across.*did you mean unit = "um"'),
        "tiny": (1e-3 * vertices, faces, r'unit = "mm" the body is 8e-05 m across.*did you mean unit = "m"'),
        "not a number": (np.where(vertices == vertices[0], np.nan, vertices), faces, "vertex 1 of 162 is not a finite"),
    }


@pytest.mark.parametrize("name", bad_bodies())
def test_bad_meshes_are_named(tmp_path, name):
    vertices, faces, words = bad_bodies()[name]
    with pytest.raises(ConfigurationError, match=words):
        Mesh(file=write_body(tmp_path / "bad.obj", vertices, faces))


def test_many_places_far_from_a_body_take_little_memory(breast):
    """Asked at once they took 87 MB, and the 7500 of a plan 870; each has the answer that it has alone."""
    body, random = Mesh(file=breast).body, np.random.default_rng(1)
    places = random.uniform([-0.03, -0.02, 0.1], [0.03, 0.02, 0.15], (1500, 3))
    body.nearest(places[:1])
    tracemalloc.start()
    feet, faces = body.nearest(places)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 30e6
    alone = [body.nearest(place[None]) for place in places[::97]]
    assert np.array_equal(faces[::97], [face[0] for _, face in alone])
    assert np.array_equal(feet[::97], [foot[0] for foot, _ in alone])


@pytest.mark.slow
def test_files_that_are_no_mesh_are_named(breast, tmp_path):
    data = breast.read_bytes()
    texts = {"cut.stl": data[: len(data) // 2], "empty.ply": b"", "text.obj": b"hello\n", "x.stl": b"solid\n\x00\x01"}
    for name, content in texts.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigurationError, match=f"{name}.*(cannot be read as a mesh|triangles)"):
            Mesh(file=tmp_path / name)
    with pytest.raises(ConfigurationError, match=r"no\.stl: no such file"):
        Mesh(file=tmp_path / "no.stl")
    (tmp_path / "step.stp").write_text("x")
    with pytest.raises(ConfigurationError, match=r"a mesh is a file \.stl, \.ply, \.obj, not \.stp"):
        Mesh(file=tmp_path / "step.stp")
