"""The touched surface: heights, normals and curvatures of known bodies, what is refused, and touches of runs."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, LogError, surface_points
from palpate_engine import load_pipeline, run_pipeline
from palpate_surfaces import TouchedSurface
from palpate_surfaces.touches import read_touches
from palpate_testing import check_surface

from tests.surfaces.bodies import AXES, ellipsoid_truth

NOISE = 1e-4  # [m]
VISITS = """[trajectory.touch]
type = "grid-points"
duration = "2 s"
press = { bias = "3 mm", amplitude = "0.5 mm", clearance = "6 mm" }
"""
GRID = np.array([[x, y] for x in np.linspace(-1, 1, 5) for y in np.linspace(-1, 1, 5)])


def table(file, points, noise=NOISE, radius=0.0):
    """A table of touches at points (n, 3) [m]."""
    rows = [",".join(repr(1e3 * float(value)) for value in (*point, noise, radius)) for point in points]
    file.write_text("x [mm],y [mm],z [mm],u [mm],radius [mm]\n" + "\n".join(rows) + "\n")
    return file


def touched(file, points, noise=NOISE, radius=0.0):
    return TouchedSurface(touches=(table(file, points, noise, radius),))


def breast(seed, size=0.017):
    """Touches of the top of an ellipsoid, its top at the origin."""
    rng = np.random.default_rng(seed)
    lateral = GRID * [size, 0.8 * size]
    height = AXES[2] * (np.sqrt(1 - ((lateral / AXES[:2]) ** 2).sum(axis=1)) - 1)
    return np.column_stack([lateral, height + rng.normal(0.0, NOISE, len(lateral))])


def errors(surface, seed):
    """Height, normal and mean curvature at places over their uncertainties."""
    rng = np.random.default_rng(seed)
    points = surface_points(surface, rng.uniform(-0.009, 0.009, (6, 2)))
    own = points.position + np.array([0.0, 0.0, AXES[2]])
    normal, mean = ellipsoid_truth(own)
    gradient = np.linalg.norm(2 * own / AXES**2, axis=1)
    height = (((own / AXES) ** 2).sum(axis=1) - 1) / gradient / points.position_std
    angle = np.arccos(np.clip((normal * points.normal).sum(axis=1), -1.0, 1.0)) / points.normal_std
    return height, angle, (points.curvature.mean(axis=1) - mean) / points.curvature_std.max(axis=1), points


@pytest.mark.slow
def test_it_is_the_body_within_its_uncertainty(tmp_path):
    height, angle, curvature, points = errors(touched(tmp_path / "t.csv", breast(0)), 1)
    assert np.abs(height).max() < 3
    assert angle.max() < 3
    assert np.abs(curvature).max() < 3
    assert points.position_std.max() < 1.5 * NOISE
    assert points.normal_std.max() < math.radians(1.5)


@pytest.mark.slow
def test_it_covers(tmp_path):
    heights, angles, curvatures, _ = zip(*(errors(touched(tmp_path / "t.csv", breast(s)), s) for s in range(30)))
    assert 0.4 < np.mean(np.square(heights)) < 1.3
    assert np.mean(np.array(angles) < 2.45) >= 0.95
    assert np.mean(np.abs(curvatures) < 1.96) >= 0.95


@pytest.mark.slow
def test_it_passes_the_checks_of_every_surface(tmp_path):
    check_surface(touched(tmp_path / "t.csv", breast(0)), np.array([[0.0, 0.0], [0.008, 0.002], [-0.007, -0.006]]))


@pytest.mark.slow
def test_an_inclined_plane_stays_one(tmp_path):
    lateral = 0.03 * GRID
    points = surface_points(
        touched(tmp_path / "t.csv", np.column_stack([lateral, 0.2 * lateral[:, 0] + 1e-3])), np.array([[0.01, 0.01]])
    )
    np.testing.assert_allclose(points.position, [[0.01, 0.01, 0.003]], atol=1e-6)
    np.testing.assert_allclose(points.normal, [np.array([-0.2, 0.0, 1.0]) / math.hypot(1, 0.2)], atol=1e-4)
    assert np.abs(points.curvature).max() < 2 * points.curvature_std.max()


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_ball_and_a_bowl(tmp_path, side):
    """40 mm: touched as far as 60 degrees from its middle; the height of a place above it is along the radius."""
    angles = np.radians([0.0, *[25.0] * 6, *[45.0] * 8, *[60.0] * 10])
    around = np.concatenate([[0.0], *(np.arange(n) * 2 * np.pi / n for n in (6, 8, 10))])
    out = np.column_stack([np.sin(angles) * np.cos(around), np.sin(angles) * np.sin(around), np.cos(angles)])
    surface = touched(tmp_path / "t.csv", side * 0.04 * (out - [0.0, 0.0, 1.0]))
    place = side * 0.04 * (np.array([[math.sin(0.8), 0.0, math.cos(0.8)]]) * 1.1 - [0.0, 0.0, 1.0])
    points = surface_points(surface, place)
    np.testing.assert_allclose(points.height, 0.004 * side, atol=2e-5)
    np.testing.assert_allclose(points.normal, [[math.sin(0.8), 0.0, math.cos(0.8)]], atol=5e-3)
    np.testing.assert_allclose(points.curvature, side * 25.0, rtol=0.03)


@pytest.mark.slow
def test_spheres_that_touch_beside_their_end_are_known(tmp_path):
    """On a ball of 40 mm a sphere of 5 mm stands as if on one of 45 mm; the skin is that of 40."""
    lateral = 0.02 * GRID
    end = np.sqrt(0.045**2 - (lateral**2).sum(axis=1)) - 0.045
    asked = 0.01 * GRID[:3]
    surface = touched(tmp_path / "t.csv", np.column_stack([lateral, end]), radius=0.005)
    points = surface_points(surface, asked)
    np.testing.assert_allclose(points.position[:, 2], np.sqrt(0.04**2 - (asked**2).sum(axis=1)) - 0.04, atol=3e-5)
    np.testing.assert_allclose(points.curvature, 25.0, rtol=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p[:5], "these are 5; a surface is made of 6 to 500"),
        (lambda p: np.column_stack([p[:, 0], 2 * p[:, 0], p[:, 2]]), "they lie on one line"),
        (
            lambda p: p + (np.arange(25) == 7)[:, None] * [0.0, 0.0, 0.004],
            "touch 8 is .* standard deviations from what",
        ),
    ],
)
def test_touches_that_make_no_surface_are_refused(tmp_path, change, words):
    with pytest.raises(ConfigurationError, match=words):
        touched(tmp_path / "t.csv", change(breast(0)))


@pytest.mark.slow
def test_more_than_a_half_sphere_and_undercuts_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    out = rng.normal(size=(60, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    with pytest.raises(ConfigurationError, match="deg from their middle; a bulge may reach to a half sphere"):
        touched(tmp_path / "t.csv", 0.03 * out[out[:, 2] > -0.6])
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.016, 0.016, 11), np.linspace(-0.016, 0.016, 11)))
    steep = np.column_stack([x, y, 0.03 * np.exp(-(x * x + y * y) / 0.006**2)])
    with pytest.raises(ConfigurationError, match="deg steep against their best"):
        touched(tmp_path / "t.csv", steep)


def test_what_was_not_touched_is_refused(tmp_path):
    surface = touched(tmp_path / "t.csv", breast(0))
    with pytest.raises(ConfigurationError, match=r"place 2 of 2 \(x 21.5, y 0.0 mm\): outside of what was touched"):
        surface_points(surface, np.array([[0.0, 0.0], [0.0215, 0.0]]))


@pytest.fixture(scope="module")
def palpations(root, tmp_path_factory):
    """Runs on a simulated skin that is inclined by 8 degrees: six of a place each, and one of four places."""
    folder = tmp_path_factory.mktemp("runs")
    head, rest = (root / "pipelines" / "point.toml").read_text().split("[trajectory.press]")
    text = head + "{motion}" + rest[rest.index("[alignment]") :]
    sets = (
        'device.rig.specimen.relief.tilt_x="8 deg"',
        "device.rig.specimen.friction=0.0",
        'alignment.lateral_x="rig.tip.x"',
        'alignment.lateral_y="rig.tip.y"',
    )
    places = [(x, y) for x in (-10, 0, 10) for y in (-8, 8)]
    motions = {f"{n}": [place] for n, place in enumerate(places)} | {"together": places[:4]}
    for name, own in motions.items():
        asked = ", ".join(f'["{x} mm", "{y} mm"]' for x, y in own)
        (folder / f"{name}.toml").write_text(text.replace("{motion}", f"{VISITS}places = [{asked}]\n\n"))
        run_pipeline(load_pipeline(folder / f"{name}.toml", sets), folder / name)
    return folder


@pytest.mark.slow
def test_the_palpations_of_runs_are_touches(palpations, palpate, tmp_path):
    runs = [palpations / f"{n}" for n in range(6)]
    done = palpate("calibrate", "touches", *runs, "-o", tmp_path / "touches.csv")
    assert done.returncode == 0, done.stderr
    assert "6 touches, known to" in done.stdout
    touches, again = read_touches(runs), read_touches([tmp_path / "touches.csv"])
    np.testing.assert_allclose(again.position, touches.position, atol=1e-9)
    assert again.name == touches.name
    assert set(touches.radius) == {0.005}
    surface = TouchedSurface(touches=(tmp_path / "touches.csv",))
    points = surface_points(surface, np.array([[0.0, 0.0]]))
    off = math.acos(points.normal[0, 2]) - math.radians(8.0)
    assert abs(off) < 3 * points.normal_std[0]
    assert points.normal_std[0] < math.radians(4.0)


@pytest.mark.slow
def test_a_run_that_does_not_fit_has_no_touches(palpations):
    with pytest.raises(LogError, match=r"does not fit its record \(lack-of-fit\)"):
        read_touches([palpations / "together"])
