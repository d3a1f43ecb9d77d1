"""Registration: coverage, what bodies leave open, touches that contradict, and the file."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_surfaces import HalfEllipsoid, Mesh
from palpate_surfaces.registration import distances, moved, register
from palpate_surfaces.registration_file import file_digest, read_registration
from palpate_surfaces.touches import Touches, read_touches

from tests.surfaces.bodies import AXES, ellipsoid, half, icosphere, sheet, write_body

NOISE = 1e-4  # [m]
CLOSE = {"position_uncertainty": 1.5e-3, "rotation_uncertainty": 0.06, "shape_uncertainty": 0.0}


@pytest.fixture(scope="module")
def breast(tmp_path_factory):
    file = write_body(tmp_path_factory.mktemp("breast") / "breast.stl", *half(*ellipsoid(3)))
    return Mesh(file=file, position=(0.0, 0.0, -0.04), **CLOSE)


def at(mesh, pose):
    """The same mesh at another pose; its triangles are read once."""
    there = mesh.model_copy()
    vars(there).update(body=mesh.body, pose=pose)
    return there


def touches_on(mesh, lateral, radius, rng):
    """Where a sphere that comes down along z meets a mesh, with noise along the normal."""
    centre = np.column_stack([lateral, np.full(len(lateral), 0.01)])
    for _ in range(8):
        points = mesh.nearest(centre)
        centre[:, 2] -= (points.height - radius) / points.normal[:, 2]
    centre[:, 2] += rng.normal(0.0, NOISE, len(centre)) / points.normal[:, 2]
    one = np.ones(len(lateral))
    return Touches(centre - [0.0, 0.0, radius], radius * one, NOISE * one, tuple(f"touch {i}" for i in range(len(one))))


def attempt(breast, seed):
    """A body that stands somewhere, eight touches, and errors of heights and normals over their uncertainties."""
    rng = np.random.default_rng(seed)
    true = at(breast, moved(breast.pose, rng.normal(0.0, np.repeat([1.5e-3, 0.06], 3))))
    registered = register(breast, touches_on(true, rng.uniform(-0.012, 0.012, (8, 2)), 0.005, rng))
    points = true.uppermost(rng.uniform(-0.01, 0.01, (5, 2)))
    own = at(breast, registered.pose).nearest(points.position)
    turned = np.arccos(np.clip((own.normal * points.normal).sum(axis=1), -1.0, 1.0))
    return own.height / own.position_std, turned / own.normal_std, registered


@pytest.mark.slow
def test_eight_touches_cover_in_95_of_100(breast):
    heights, turns, registered = zip(*(attempt(breast, seed) for seed in range(100)))
    assert np.mean(np.abs(heights) < 1.96) >= 0.92
    assert np.mean(np.square(heights)) == pytest.approx(1.0, abs=0.3)
    assert np.mean(np.array(turns) < 2.45) >= 0.92
    assert np.mean([one.probability < 0.01 for one in registered]) <= 0.05


@pytest.mark.gate
@pytest.mark.slow
def test_eight_touches_register_it(breast):
    height, turn, registered = attempt(breast, 3)
    assert np.abs(height).max() < 3
    assert turn.max() < 3.5
    assert registered.residual < 2 * NOISE
    assert registered.scale == 1.0
    assert np.sqrt(np.diag(registered.pose.covariance))[2] < 0.3 * CLOSE["position_uncertainty"]


@pytest.mark.parametrize("radius", [0.0, 0.005])
def test_the_radius_of_the_tip_counts_on_an_inclined_skin(breast, radius):
    """On a skin of 40 degrees a sphere of 5 mm stands 1.5 mm higher than its point would."""
    rng = np.random.default_rng(0)
    touches = touches_on(breast, np.array([[0.015, 0.0], [0.0, 0.0]]), radius, rng)
    distance, _ = distances(breast, touches)
    assert np.abs(distance).max() < 3 * NOISE


@pytest.mark.slow
def test_a_body_of_revolution_keeps_its_spin(tmp_path):
    vertices, faces = icosphere(4)
    file = write_body(tmp_path / "round.stl", *half(vertices * [0.03, 0.03, 0.05], faces))
    mesh = Mesh(file=file, position=(0.0, 0.0, -0.05), rotation_uncertainty=0.2)
    rng = np.random.default_rng(0)
    true = at(mesh, moved(mesh.pose, np.array([2e-3, -1e-3, 1e-3, 0.1, -0.05, 0.15])))
    ring = [[0.02 * math.cos(a), 0.02 * math.sin(a)] for a in np.arange(9) * 2 * math.pi / 9]
    registered = register(mesh, touches_on(true, np.array([[0.0, 0.0], *ring]), 0.0, rng))
    assert len(registered.open) == 1
    assert "a turn about the axis" in registered.open[0]
    assert "held to ± 11." in registered.open[0]
    # It is turned about its own axis by what was stated, which is nothing.
    assert abs((registered.pose.matrix @ [1.0, 0.0, 0.0]) @ [0.0, 1.0, 0.0]) < 0.03


@pytest.mark.slow
def test_a_sheet_keeps_its_place_along_itself(tmp_path):
    mesh = Mesh(file=write_body(tmp_path / "sheet.obj", *sheet()))
    rng = np.random.default_rng(0)
    registered = register(mesh, touches_on(mesh, rng.uniform(-0.04, 0.04, (8, 2)), 0.0, rng))
    assert len(registered.open) == 3
    assert sum("a shift along" in words for words in registered.open) == 2
    assert sum("axis (0.00, 0.00," in words for words in registered.open) == 1


@pytest.mark.slow
def test_touches_that_scatter_more_than_they_say_widen_it(breast):
    rng = np.random.default_rng(5)
    touches = touches_on(breast, rng.uniform(-0.012, 0.012, (12, 2)), 0.0, rng)
    rough = touches.position + rng.normal(0.0, 5 * NOISE, (12, 1)) * [0.0, 0.0, 1.0]
    registered = register(breast, Touches(rough, touches.radius, touches.std, touches.name))
    assert registered.probability < 0.01
    assert registered.scale > 4


def write_touches(file, touches, extra=""):
    rows = [
        ",".join(f"{1e3 * float(value)!r}" for value in (*place, u)) for place, u in zip(touches.position, touches.std)
    ]
    file.write_text("x [mm],y_mm,z (mm),u mm\n" + "\n".join(rows) + f"\n{extra}")
    return file


@pytest.fixture
def mesh_and_touches(breast, tmp_path):
    """A pipeline of the mesh with two tables of touches, and the pose at which they were made."""
    breast.file.with_name("breast.toml").write_text(
        '[surface.breast]\ntype = "mesh"\nfile = "breast.stl"\nposition = ["0 mm", "0 mm", "-40 mm"]\n'
    )
    rng = np.random.default_rng(8)
    true = at(breast, moved(breast.pose, np.array([3e-3, -2e-3, 1e-3, 0.05, 0.02, -0.03])))
    for name in ("first", "second"):
        write_touches(tmp_path / f"{name}.csv", touches_on(true, rng.uniform(-0.012, 0.012, (8, 2)), 0.0, rng))
    return breast.file.with_name("breast.toml"), tmp_path, true


@pytest.mark.slow
def test_the_command_writes_what_the_mesh_reads(mesh_and_touches, palpate):
    pipeline, folder, true = mesh_and_touches
    registration = folder / "registration.toml"
    done = palpate("calibrate", "surface", pipeline, folder / "first.csv", "-o", registration)
    assert done.returncode == 0, done.stderr
    assert "breast.stl: 8 touches" in done.stdout
    mesh = Mesh(file=true.file, registration=registration, shape_uncertainty=0.0)
    points = mesh.nearest(true.uppermost(np.array([[0.0, 0.0], [0.01, 0.0]])).position)
    assert (np.abs(points.height) < 3 * points.position_std).all()
    assert (points.position_std < 3e-4).all()
    assert read_registration(registration, file_digest(true.file)).touches == 8


@pytest.mark.slow
def test_later_touches_refine_it_and_count_once(mesh_and_touches, palpate):
    pipeline, folder, _ = mesh_and_touches
    first, second = folder / "one.toml", folder / "two.toml"
    palpate("calibrate", "surface", pipeline, folder / "first.csv", "-o", first)
    table = f'surface.breast={{type = "mesh", file = "breast.stl", registration = "{first}"}}'
    pipeline.with_name("again.toml").write_text(
        table.replace("=", " = ", 1).replace("surface.breast", "[surface]\nbreast")
    )
    again = pipeline.with_name("again.toml")
    done = palpate("calibrate", "surface", again, folder / "second.csv", "-o", second)
    assert done.returncode == 0, done.stderr
    digest = file_digest(pipeline.with_name("breast.stl"))
    one, two = (read_registration(file, digest) for file in (first, second))
    assert two.touches == 16
    assert np.trace(two.pose.covariance[:3, :3]) < 0.8 * np.trace(one.pose.covariance[:3, :3])
    done = palpate("calibrate", "surface", again, folder / "first.csv", "-o", folder / "three.toml")
    assert done.returncode == 2
    assert "first.csv already; it counts once" in done.stderr


@pytest.mark.slow
def test_a_mesh_5_mm_off_is_refused_by_the_first_touches(mesh_and_touches, palpate):
    pipeline, folder, true = mesh_and_touches
    registration = folder / "registration.toml"
    palpate("calibrate", "surface", pipeline, folder / "first.csv", "-o", registration)
    again = pipeline.with_name("off.toml")
    again.write_text(f'[surface.breast]\ntype = "mesh"\nfile = "breast.stl"\nregistration = "{registration}"\n')
    aside = at(true, moved(true.pose, np.array([5e-3, 0.0, 0.0, 0.0, 0.0, 0.0])))
    few = touches_on(aside, np.array([[0.012, 0.0], [-0.012, 0.0], [0.0, 0.012]]), 0.0, np.random.default_rng(0))
    done = palpate("calibrate", "surface", again, write_touches(folder / "few.csv", few), "-o", folder / "no.toml")
    assert done.returncode == 2
    assert "touches contradict where breast.stl stands by" in done.stderr
    assert "few.csv, touch" in done.stderr
    assert not (folder / "no.toml").exists()


@pytest.mark.slow
def test_a_touch_that_does_not_fit_is_named(mesh_and_touches, palpate):
    pipeline, folder, true = mesh_and_touches
    touches = touches_on(true, np.random.default_rng(2).uniform(-0.012, 0.012, (10, 2)), 0.0, np.random.default_rng(2))
    touches.position[6, 2] += 1e-3
    done = palpate(
        "calibrate", "surface", pipeline, write_touches(folder / "bad.csv", touches), "-o", folder / "no.toml"
    )
    assert done.returncode == 2
    assert "do not fit the others: bad.csv, touch 7 is 0." in done.stderr


@pytest.mark.slow
def test_a_pipeline_without_its_mesh_is_refused(mesh_and_touches, palpate):
    pipeline, folder, _ = mesh_and_touches
    (folder / "flat.toml").write_text('[surface.table]\ntype = "plane"\n')
    for file, option, words in [
        (folder / "flat.toml", (), "has no [surface.*] of type mesh"),
        (pipeline, ("--surface", "brest"), "has no mesh 'brest' (there are: breast)"),
        (pipeline, ("--uncertainty", "0 mm"), "--uncertainty: 0 mm is not above 0"),
        (pipeline, ("-o", folder / "no" / "where.toml"), "cannot write: No such file or directory"),
    ]:
        done = palpate("calibrate", "surface", file, folder / "first.csv", *option)
        assert done.returncode == 2
        assert words in done.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no column 'x'"),
        ("x [mm],y [mm],z [mm],u [mm]\n", "has no touches below its header"),
        ("x [mm],y [mm],z [mm]\n1,2,3\n", "how well was it touched"),
        ("x,y [mm],z [mm]\n1,2,3\n", "column 'x' has no unit"),
        ("x [mm],y [mm],q [mm]\n1,2,3\n", "a column is called 'q"),
        ("x [mm],x [mm],z [mm]\n1,2,3\n", "column 'x' is there twice"),
        ("x [kPa],y [mm],z [mm],u [mm]\n1,2,3,1\n", "touch 1, x: .*is a pressure, not a length"),
        ("x [mm],y [mm],z [mm],u [mm]\n1,2,3,1\n1,2,nan,1\n", "touch 2, z: 'nan' is not a finite number"),
        ("x [mm],y [mm],z [mm],u [mm]\n1,2\n", "touch 1, z: '' is not a number"),
        ("x [mm],y [mm],z [mm],u [mm]\n1,2,3,0\n", "touch 1: an uncertainty is above 0"),
        (b"\xff\xfe", "not UTF-8 text"),
    ],
)
def test_bad_tables_of_touches_are_named(tmp_path, text, words):
    file = tmp_path / "touches.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigurationError, match=words):
        read_touches([file])


@pytest.mark.slow
def test_a_registration_of_another_mesh_is_refused(breast, tmp_path, mesh_and_touches, palpate):
    pipeline, folder, _ = mesh_and_touches
    registration = folder / "registration.toml"
    palpate("calibrate", "surface", pipeline, folder / "first.csv", "-o", registration)
    other = write_body(tmp_path / "other.stl", *half(*ellipsoid(3, AXES * 1.1)))
    with pytest.raises(ConfigurationError, match="it registers another mesh"):
        Mesh(file=other, registration=registration)
    for change, words in [("format = 1", "format = 2"), ("touches = 8", 'touches = "8"'), ("pivot", "pviot")]:
        registration.write_text(registration.read_text().replace(change, words, 1))
        with pytest.raises(ConfigurationError, match=r"is not a registration|is a damaged registration"):
            Mesh(file=breast.file, registration=registration)
        registration.write_text(registration.read_text().replace(words, change, 1))


@pytest.mark.slow
def test_palpations_along_the_normals_touch_where_the_skin_is(palpate, root, tmp_path):
    """The skin of a half ellipsoid that is 1 mm higher than its surface says, where that is inclined by 20 degrees."""
    grid = ["trajectory.points.size=['18 mm', '12 mm']", "trajectory.points.centre=['-25 mm', '12 mm']"]
    sets = [*grid, "device.rig.specimen.inclusions=[]", "device.rig.specimen.surface=1 mm"]
    words = [word for one in sets for word in ("--set", one)]
    done = palpate("run", root / "pipelines" / "breast.toml", *words, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert palpate("calibrate", "touches", tmp_path / "out", "-o", tmp_path / "touches.csv").returncode == 0
    table = np.genfromtxt(tmp_path / "touches.csv", delimiter=",", skip_header=1, usecols=range(5)) * 1e-3
    centre, radius = table[:, :3] + [[0.0, 0.0, 0.005]] - [[0.0, 0.0, 1e-3]], table[:, 4]
    apart = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04)).nearest(centre).height - radius
    assert len(apart) == 12
    np.testing.assert_allclose(apart, 0.0, atol=0.4e-3)
    text = (tmp_path / "out" / "pipeline.toml").read_text()
    assert 'surface = "breast"' in text
    (tmp_path / "out" / "pipeline.toml").write_text(text.replace('surface = "breast"', "normal = [0.0, 0.0, 1.0]"))
    refused = palpate("calibrate", "touches", tmp_path / "out", "-o", tmp_path / "none.csv")
    assert refused.returncode == 2
    assert "its heights are along a stated normal ([alignment] normal), not along z" in " ".join(refused.stderr.split())
