"""Skins of the simulated rig that are tilted or curved: their form, and the force on a tip."""

import math

import numpy as np
import pytest
from palpate.errors import ConfigurationError
from palpate_models import DimensionalityReduction, Flat, Sphere
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.skin_form import SkinForm, elliptic_share
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen

R, COUNT, DEPTH = 5e-3, 600, 3e-3
MODEL = DimensionalityReduction(indenter=Sphere(radius=R))


def specimen(friction=0.0, viscosity=0.0, model=MODEL, **relief):
    parameters = {"elasticity": 112.5e3, "viscosity": viscosity}
    return Specimen(model=model, friction=friction, relief=relief, **parameters)


def press(body, pieces=1, speed=10e-3):
    """Force (n, 3) of a press straight down, from the first touch to DEPTH, asked for in so many pieces."""
    touch = 0.0
    for _ in range(50):
        touch += float(SkinUnderTip(body, np.array([[0.0, 0.0, touch]])).depth[0])
    position, velocity = np.zeros((COUNT, 3)), np.zeros((COUNT, 3))
    position[:, 2], velocity[:, 2] = touch - np.linspace(0.0, DEPTH, COUNT), -speed
    contact, time = SkinContact(), np.linspace(0.0, DEPTH, COUNT) / speed
    rows = np.array_split(np.arange(COUNT), pieces)
    return np.concatenate([contact.force(body, time[r], position[r], velocity[r]) for r in rows])


@pytest.mark.parametrize("viscosity", [0.0, 362.0])
@pytest.mark.parametrize(("friction", "across", "along"), [(0.0, 0.364, -14.4), (1.0, 0.111, -6.8)])
def test_a_tilt_of_20_degrees_has_the_forces_of_one_that_slides_or_sticks(friction, across, along, viscosity):
    last = press(specimen(friction, viscosity, tilt_x=math.radians(20)))[-1]
    level = MODEL.force(DEPTH, 10e-3, (112.5e3, viscosity))
    assert np.hypot(*last[:2]) / last[2] == pytest.approx(across, abs=2e-3)
    assert 100 * (last[2] / level - 1) == pytest.approx(along, abs=0.15)
    assert last[0] < 0  # a skin that rises towards x pushes back


def test_friction_is_never_more_than_its_share_of_the_force_along_the_normal():
    t = math.radians(30)
    force = press(specimen(0.3, tilt_y=t))
    normal = np.array([0.0, -math.sin(t), math.cos(t)])
    pushed = force @ normal
    across = np.linalg.norm(force - pushed[:, None] * normal, axis=1)
    assert (across <= 0.3 * pushed * (1 + 1e-9)).all()
    assert across[-1] == pytest.approx(0.3 * pushed[-1])  # 2/3 tan 30 deg is more
    assert (force[1:, 0] == 0).all()


@pytest.mark.gate
@pytest.mark.slow
def test_the_force_is_the_same_asked_for_at_once_or_tick_by_tick():
    body = specimen(0.5, 300.0, tilt_x=0.2, radius_x=0.05, radius_y=0.03)
    np.testing.assert_allclose(press(body, pieces=COUNT), press(body), rtol=1e-9)


@pytest.mark.parametrize("radius", [0.03, -0.03])
def test_on_a_sphere_it_is_the_distance_from_its_centre(radius):
    form = SkinForm((0.2, -0.1), (1 / radius, 1 / radius))
    points = np.random.default_rng(0).uniform(-5e-3, 5e-3, (50, 3))
    normal = np.array([-0.2, 0.1, 1.0]) / math.sqrt(1.05)
    away = points + radius * normal
    distance, normals = form.near(points)
    assert distance == pytest.approx(math.copysign(1, radius) * np.linalg.norm(away, axis=1) - radius, abs=1e-12)
    assert normals == pytest.approx(away / np.linalg.norm(away, axis=1)[:, None] * math.copysign(1, radius), abs=1e-9)


@pytest.mark.parametrize("curvatures", [(0.0, 0.0), (20.0, 0.0), (0.0, 40.0), (30.0, -15.0), (-10.0, 25.0)])
def test_a_height_is_on_the_skin_and_the_normal_is_the_slope_of_the_distance(curvatures):
    form = SkinForm((0.3, 0.1), curvatures)
    x, y = np.random.default_rng(1).uniform(-5e-3, 5e-3, (2, 40))
    surface = np.column_stack([x, y, form.height(x, y)])
    assert form.near(surface)[0] == pytest.approx(0.0, abs=1e-11)
    above = surface + np.array([0.0, 0.0, 1e-3])
    _, normal = form.near(above)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-7
        slope = (form.near(above + step)[0] - form.near(above - step)[0]) / 2e-7
        assert slope == pytest.approx(normal[:, axis], abs=1e-7)


def test_beside_a_body_there_is_no_skin():
    form = SkinForm((0.0, 0.0), (50.0, 50.0))
    with np.errstate(all="ignore"):
        assert form.height(np.array([0.0, 0.01, 0.03]), np.zeros(3)) == pytest.approx(
            [0.0, math.sqrt(3e-4) - 0.02, -np.inf]
        )


@pytest.mark.parametrize("narrow", [0.95, 0.7, 0.4])
def test_the_ellipse_is_that_of_an_ellipsoid_of_pressure(narrow):
    """Displacement L - M x^2 - N y^2 under p0 sqrt(1 - x^2/a^2 - y^2/b^2): Johnson 1985, eqs. 3.40 and 3.41."""
    from scipy.integrate import quad

    a, b = 1.0, narrow
    across, along, deep = (
        a * b * quad(lambda s, p=p, q=q: ((a * a + s * s) ** -p) * ((b * b + s * s) ** -q), 0, np.inf)[0]
        for p, q in ((0.5, 1.5), (1.5, 0.5), (0.5, 0.5))
    )
    radius = 1.0 / (2.0 * along)  # of the tip, on a skin that is curved across only
    share = 2.0 / 3.0 * math.pi * a * b / (4.0 / 3.0 * math.sqrt(radius) * deep**1.5)
    assert elliptic_share(radius, (0.0, 2.0 * across - 2.0 * along)) == pytest.approx(share, rel=1e-6)


def test_a_skin_that_is_tilted_and_rough_is_rough_along_the_normal():
    rough = specimen(tilt_x=0.2, roughness=1e-4, seed=3)
    smooth = specimen(tilt_x=0.2)
    place = np.array([[0.01, 0.0, 0.0]])
    more = SkinUnderTip(rough, place).depth - SkinUnderTip(smooth, place).depth
    assert more == pytest.approx(math.cos(0.2) * rough.relief.without_form.height_at(*place.T[:2]))


@pytest.mark.parametrize("relief", [{}, {"tilt_x": 0.2}, {"tilt_x": 0.2, "radius_y": 0.05}])
def test_a_skin_that_is_worked_out_once_pushes_as_one_that_is_worked_out_for_each_speed(relief):
    body = specimen(viscosity=362.0, roughness=1e-4, seed=3, **relief)
    position, velocity = np.random.default_rng(2).normal(0.0, 1e-3, (2, 20, 3)) - np.array([0.0, 0.0, 3e-3])
    time, under = np.arange(20.0), SkinUnderTip(body, position)
    pushes = [under.push(time, speed * velocity) for speed in (0.0, 1.0, 2.0)]
    for speed, push in zip((0.0, 1.0, 2.0), pushes, strict=True):
        np.testing.assert_array_equal(push, SkinUnderTip(body, position).push(time, speed * velocity))
    assert pushes[2] - pushes[1] == pytest.approx(pushes[1] - pushes[0])  # damping is linear in the speed
    assert (pushes[1] > pushes[0]).any()


def test_what_the_model_states_of_the_skin_is_not_the_true_one():
    stated = DimensionalityReduction.model_validate({"indenter": Sphere(radius=R), "skin": {"inclination": "20 deg"}})
    np.testing.assert_array_equal(press(specimen(model=stated)), press(specimen()))


@pytest.mark.parametrize(
    ("model", "relief", "word"),
    [
        (DimensionalityReduction(indenter=Flat(radius=R)), {"radius_x": 0.05}, "round end"),
        (MODEL, {"radius_x": -4e-3}, "narrower than the tip"),
        (MODEL, {"radius_y": 0.0}, 'write "flat"'),
    ],
)
def test_a_skin_that_the_tip_cannot_touch_is_refused(model, relief, word):
    with pytest.raises(ConfigurationError, match=word):
        specimen(model=model, **relief)
