"""The ellipsoid: against a sphere, against its own equation, and against small steps along it."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, surface_points
from palpate_surfaces import HalfEllipsoid
from palpate_testing import check_surface

BREAST = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04), spin=0.3)
LATERAL = np.random.default_rng(1).uniform(-0.03, 0.03, (200, 2))


def test_it_passes_the_checks_of_every_surface():
    check_surface(BREAST, LATERAL[:10])


def test_a_sphere_is_one():
    sphere = HalfEllipsoid(half_axes=(0.05, 0.05, 0.05), centre=(0.01, -0.02, -0.03))
    ways = np.random.default_rng(2).standard_normal((100, 3))
    ways = np.abs(ways / np.linalg.norm(ways, axis=1)[:, None]) * [1, 1, 1]
    distance = np.linspace(-0.01, 0.1, 100)
    points = surface_points(sphere, np.array([0.01, -0.02, -0.03]) + (0.05 + distance)[:, None] * ways)
    np.testing.assert_allclose(points.height, distance, atol=1e-9)
    np.testing.assert_allclose(points.normal, ways, atol=1e-6)
    np.testing.assert_allclose(points.curvature, 20.0, rtol=1e-6)


def test_the_nearest_point_is_nearest_and_straight_below():
    above = surface_points(BREAST, LATERAL)
    away = np.random.default_rng(3).uniform(-0.008, 0.03, 200)
    places = above.position + away[:, None] * above.normal
    points = surface_points(BREAST, places)
    np.testing.assert_allclose(points.height, away, atol=1e-9)
    np.testing.assert_allclose(points.position, above.position, atol=2e-8)
    others = surface_points(BREAST, LATERAL + 1e-4)
    assert (np.linalg.norm(places - others.position, axis=1) > np.abs(away)).all()


def test_curvatures_are_those_of_the_turn_of_the_normal():
    """The normal turns by k ds along each principal direction: trace and determinant of d n over d s."""
    step, points = 1e-6, surface_points(BREAST, LATERAL)
    flat = np.cross(points.normal, [0.0, 1.0, 0.0])
    first = flat / np.linalg.norm(flat, axis=1)[:, None]
    second = np.cross(points.normal, first)
    shape = np.empty((200, 2, 2))
    for i, way in enumerate((first, second)):
        ahead, behind = (surface_points(BREAST, points.position + by * way).normal for by in (step, -step))
        turn = (ahead - behind) / (2.0 * step)
        shape[:, i] = np.column_stack([(turn * first).sum(axis=1), (turn * second).sum(axis=1)])
    np.testing.assert_allclose(points.curvature.sum(axis=1), np.trace(shape, axis1=1, axis2=2), rtol=1e-4)
    np.testing.assert_allclose(points.curvature.prod(axis=1), np.linalg.det(shape), rtol=1e-3)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((0.0, 0.0, -0.035), "too deep inside the ellipsoid"),
        ((0.0, 0.0, -0.04), "too deep inside the ellipsoid"),
        ((0.08, 0.0, -0.05), "below the rim of the ellipsoid"),
        ((0.07, 0.0), "off the ellipsoid"),
    ],
)
def test_what_is_not_known_is_refused(place, words):
    with pytest.raises(ConfigurationError, match=words):
        surface_points(BREAST, np.array([place]))


def test_its_top_is_the_origin_and_its_spin_turns_it():
    top = surface_points(BREAST, np.zeros((1, 2)))
    np.testing.assert_allclose(top.position, 0.0, atol=1e-12)
    np.testing.assert_allclose(top.curvature, [[0.04 / 0.05**2, 0.04 / 0.06**2]], rtol=1e-9)
    widest = 0.059 * np.array([[math.cos(0.3), math.sin(0.3)]])
    assert surface_points(BREAST, widest).position[0, 2] == pytest.approx(-0.04 + 0.04 * math.sqrt(1 - (59 / 60) ** 2))
