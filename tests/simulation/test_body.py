"""A surface as the skin of a simulated specimen: the forces of a skin whose radii are given, and Hertz's ellipse."""

import json

import numpy as np
import pytest
from palpate import ConfigurationError, Setpoint
from palpate_models import Cone, DimensionalityReduction, Sphere
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.skin_form import elliptic_share
from palpate_simulation.skin_on_surface import SkinOnSurface
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen
from palpate_surfaces import HalfEllipsoid, Plane

DR = DimensionalityReduction(indenter=Sphere(radius=0.005))
TRUE = {"model": DR, "elasticity": 6e4, "viscosity": 200.0}
BREAST = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04))


def press(specimen, place=(0.0, 0.0), normal=(0.0, 0.0, 1.0)):
    """Force (n, 3) [N] of a press along a normal to 3 mm and back, to a tip whose tool looks along it."""
    time = np.arange(0.0, 1.0, 0.002)
    depth, rate = -0.003 * np.sin(np.pi * time), -0.003 * np.pi * np.cos(np.pi * time)
    position = np.array([*place, 0.0]) + depth[:, None] * np.array(normal)
    return SkinContact().force(specimen, time, position, rate[:, None] * np.array(normal))


def test_a_sphere_and_two_equal_radii_are_one_skin():
    by_relief = press(Specimen(**TRUE, friction=0.4, relief={"radius_x": "50 mm", "radius_y": "50 mm"}))
    by_body = press(Specimen(**TRUE, friction=0.4, body=HalfEllipsoid(half_axes=(0.05, 0.05, 0.05))))
    np.testing.assert_allclose(by_body, by_relief, rtol=1e-5, atol=1e-7)
    assert by_body[:, 2].max() > 1.0


def test_a_plane_is_the_flat_skin():
    flat, body = press(Specimen(**TRUE, friction=0.4)), press(Specimen(**TRUE, friction=0.4, body=Plane()))
    np.testing.assert_allclose(body[:, 2], flat[:, 2], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("radius", [0.001, 0.005, 0.02])
def test_the_share_of_each_place_is_that_of_hertz(radius):
    lateral = np.random.default_rng(1).uniform(-0.035, 0.035, (20, 2))
    points = BREAST.uppermost(lateral)
    shares = SkinOnSurface(BREAST).share(points.position, radius)
    expected = [elliptic_share(radius, tuple(pair)) for pair in points.curvature.tolist()]
    np.testing.assert_allclose(shares, expected, rtol=1e-5)


def test_a_lump_is_felt_where_the_skin_is_over_it():
    lump = {"shape": "sphere", "place": ("25 mm", "-8 mm"), "radius": "6 mm", "depth": "5 mm"}
    specimen, plain = Specimen(**TRUE, body=BREAST, inclusions=(lump,)), Specimen(**TRUE, body=BREAST)
    there = BREAST.uppermost(np.array([[0.025, -0.008], [-0.025, 0.008]]))
    for row, felt in ((0, True), (1, False)):
        tip = there.position[row] - 0.003 * there.normal[row]
        at = tip + DR.indenter.radius * (there.normal[row] - [0.0, 0.0, 1.0])  # as `upright_place` has it
        stiff, soft = (float(np.ravel(SkinUnderTip(one, at[None]).theta[0])[0]) for one in (specimen, plain))
        assert (stiff > 1.3 * soft) if felt else (stiff == pytest.approx(soft, rel=1e-3))


def test_where_there_is_no_skin_there_is_no_force_and_no_motion():
    specimen = Specimen(**TRUE, body=BREAST)
    beside = np.array([[0.09, 0.0, -0.05]])
    assert SkinUnderTip(specimen, beside).push(np.zeros(1), np.zeros((1, 3)))[0] == 0.0
    with pytest.raises(ConfigurationError, match=r"no skin \(x 90.0, y 0.0, z -50.0 mm\): below the rim"):
        specimen.refuse(Setpoint(beside, np.zeros((1, 3)), np.ones(1, bool)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"relief": {"tilt_x": "5 deg"}}, "leave one of them out"),
        ({"model": DimensionalityReduction(indenter=Cone(angle=1.2))}, "round end"),
        ({"inclusions": ({"shape": "cylinder"},)}, 'shape = "sphere"'),
        ({"inclusions": ({"shape": "sphere", "place": ("80 mm", "0 mm")},)}, "no skin at x 80.0, y 0.0 mm: off"),
    ],
)
def test_what_a_body_cannot_have_is_refused(changes, words):
    with pytest.raises(ConfigurationError, match=words):
        Specimen(**{**TRUE, "body": BREAST, **changes})


@pytest.mark.slow
def test_a_lump_below_the_skin_of_a_body_is_found_at_its_place(palpate, root, tmp_path):
    """The one at (-20, -10) mm, 4 mm below the skin, where that is inclined by 17 degrees."""
    sets = ["trajectory.points.size=['36 mm', '24 mm']", "trajectory.points.centre=['-20 mm', '-10 mm']"]
    done = palpate(
        "run", root / "pipelines" / "breast.toml", *[w for s in sets for w in ("--set", s)], "--out", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    assert palpate("map", "lumps", tmp_path / "out").returncode == 0
    (lump,) = json.loads((tmp_path / "out" / "maps" / "lumps.json").read_text())["lumps"]
    assert np.hypot(lump["x"] + 0.020, lump["y"] + 0.010) < 0.003
