"""Spheres that stick: the theories' own numbers, Hertz where nothing sticks, and pulls in a simulated specimen."""

import numpy as np
import pytest
from palpate import contact_force
from palpate_models import (
    DerjaguinMullerToporov,
    DimensionalityReduction,
    ExactSphere,
    JohnsonKendallRoberts,
    NeoHookeanSphere,
    Sphere,
)
from palpate_testing import check_indenter, check_model

RADIUS, E, WORK = 5e-3, 1e5, 0.05
PLANE = E / 0.75
JKR = JohnsonKendallRoberts(radius=RADIUS)
DMT = DerjaguinMullerToporov(radius=RADIUS)
PULL = np.pi * WORK * RADIUS


@pytest.mark.parametrize("model", [JKR, DMT])
@pytest.mark.parametrize("work", [0.0, 1e-3, 0.05, 50.0])
def test_models_pass_their_check(model, work):
    check_model(model, [E, work])


@pytest.mark.parametrize("model", [JKR, DMT])
def test_hertz_where_nothing_sticks(model):
    depth = np.geomspace(1e-6, 4e-3, 50)
    hertz = DimensionalityReduction(indenter=Sphere(radius=RADIUS)).force(depth, 0.0, [E, 0.0])
    np.testing.assert_allclose(model.force(depth, 0.0, [E, 0.0]), hertz, rtol=1e-9)


def test_contact_radius_is_the_root_of_its_equation():
    edge = JKR.pull_off_depth([E, WORK])
    assert edge == pytest.approx(-0.75 * (np.pi**2 * WORK**2 * RADIUS / PLANE**2) ** (1 / 3))
    for depth in np.concatenate([edge * (1 - np.geomspace(1e-9, 1, 40)), np.geomspace(1e-9, 5e-3, 40)]):
        radius = JKR.contact_radius(depth, [E, WORK])
        assert radius**2 / RADIUS - np.sqrt(2 * np.pi * WORK * radius / PLANE) == pytest.approx(depth, abs=1e-12)


def test_pulls_are_the_theories():
    edge = JKR.pull_off_depth([E, WORK])
    out = contact_force(JKR, np.linspace(1.001 * edge, 1e-3, 200_001), np.full(200_001, -1.0), [E, WORK])
    assert out.min() == pytest.approx(-1.5 * PULL, rel=1e-6)
    assert out[0] == 0.0
    assert contact_force(JKR, edge * (1 - 1e-9), -1.0, [E, WORK]) == pytest.approx(-5 / 6 * PULL, rel=1e-3)
    assert contact_force(JKR, 1e-15, 1.0, [E, WORK]) == pytest.approx(-4 / 3 * PULL, rel=1e-6)
    assert contact_force(JKR, edge / 2, 1.0, [E, WORK]) == 0.0
    assert contact_force(DMT, 1e-15, -1.0, [E, WORK]) == pytest.approx(-2 * PULL, rel=1e-6)
    assert contact_force(DMT, -1e-15, -1.0, [E, WORK]) == 0.0


def test_work_is_done_in_parting():
    """Around the way in and out, the loop holds what is lost in touching and parting, and nothing else."""
    depth = np.linspace(1.5 * JKR.pull_off_depth([E, WORK]), 1e-4, 400_001)
    into = contact_force(JKR, depth, np.ones_like(depth), [E, WORK])
    out = contact_force(JKR, depth, -np.ones_like(depth), [E, WORK])
    deep = depth > 0
    np.testing.assert_array_equal(into[deep], out[deep])
    assert np.trapezoid(into - out, depth) > 0


def test_a_pull_is_not_cut_off_in_a_simulated_specimen():
    depth, rate = np.array([1e-6]), np.array([-1.0])
    assert contact_force(JKR, depth, rate, [E, WORK], pulls=False)[0] < 0
    viscous = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    assert contact_force(viscous, depth, rate, [E, 300.0], pulls=False)[0] == 0.0


def test_large_strain_is_hertz_less_15_per_cent_at_the_radius():
    tip = NeoHookeanSphere(radius=0.02)
    check_indenter(NeoHookeanSphere(radius=2e-3))
    check_indenter(tip)
    assert tip.profile_area(0.02) / Sphere(radius=0.02).profile_area(0.02) == pytest.approx(0.85)
    assert tip.profile_area(0.02) / ExactSphere(radius=0.02).profile_area(0.02) == pytest.approx(0.95, abs=0.01)
    assert not tip.validity(0.02)
    assert tip.validity(0.021)
