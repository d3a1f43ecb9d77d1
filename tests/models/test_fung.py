"""Fung's material under a sphere: its limits, finite elements, and what a press determines."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_models import DimensionalityReduction, Flat, Fung, NeoHookeanSphere, Sphere
from palpate_models.finite_elements import Cylinder, press_cylinder
from palpate_models.rigid_tip import TipProfile

R = 5e-3
TISSUE = Fung(indenter=Sphere(radius=R))


def test_without_stiffening_it_is_the_neo_hookean_sphere():
    other = DimensionalityReduction(indenter=NeoHookeanSphere(radius=R))
    for depth in (1e-4, 2e-3, 5e-3):
        assert TISSUE.force(depth, 0.01, (1e5, 300.0, 0.0)) == pytest.approx(other.force(depth, 0.01, (1e5, 300.0)))


def test_at_small_depths_it_is_hertz():
    assert TISSUE.force(1e-7, 0.0, (1e5, 0.0, 5.0)) == pytest.approx(16 / 9 * 1e5 * math.sqrt(R) * 1e-7**1.5, rel=1e-4)


@pytest.mark.parametrize(
    ("b", "share", "force"),
    [
        *[(4.0, *pair) for pair in ((0.2, 1.0539), (0.4, 1.1061), (0.6, 1.1654), (0.8, 1.2238))],
        *[(10.0, *pair) for pair in ((0.2, 1.1593), (0.4, 1.3015), (0.6, 1.4360), (0.8, 1.5667))],
    ],
)
def test_it_is_what_finite_elements_give(b, share, force):
    """Over Hertz's force; computed by benchmarks/finite_elements.py, with elements that are good for 1 %."""
    depth = share * R
    hertz = 16 / 9 * math.sqrt(R) * depth**1.5
    assert TISSUE.force(depth, 0.0, (1.0, 0.0, b)) / hertz == pytest.approx(force, rel=0.015)


@pytest.mark.slow
def test_finite_elements_agree():
    """A sphere pressed 0.4 R into a large block, coarse elements: 1.5 %."""

    def height(r):
        return R - np.sqrt(R**2 - np.minimum(np.abs(r), 0.9 * R) ** 2)

    def slope(r):
        return r / np.sqrt(R**2 - np.minimum(np.abs(r), 0.9 * R) ** 2)

    block, depths = Cylinder(40 * R, 20 * R, stiffening=4.0), R * np.array([0.2, 0.4])
    for depth, area in zip(depths, press_cylinder(block, TipProfile(height, slope, 0.85 * R), depths, 8)):
        assert TISSUE.force(depth, 0.0, (1.0, 0.0, 4.0)) == pytest.approx(area, rel=0.015)


def test_a_deep_press_determines_the_stiffening_and_a_shallow_one_does_not():
    theta = np.array([1e5, 0.0, 4.0])

    def std(deepest):
        depth = np.linspace(1e-5, deepest, 300)
        steps = np.array([[1e1, 0.0, 0.0], [0.0, 0.0, 1e-4]])
        slopes = [(TISSUE.force(depth, 0.0, theta + s) - TISSUE.force(depth, 0.0, theta)) / s.sum() for s in steps]
        return np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T / 0.02**2)))

    deep, shallow = std(0.8 * R), std(0.1 * R)
    assert deep[1] < 0.1
    assert shallow[1] > 20 * deep[1]


def test_other_tips_and_depths_are_said():
    with pytest.raises(ConfigurationError, match="known under spheres, not under a Flat"):
        Fung(indenter=Flat(radius=R))
    assert TISSUE.validity(0.8 * R) == ""
    assert "120% of the radius; stiffening is known to 80%" in TISSUE.validity(1.2 * R)
