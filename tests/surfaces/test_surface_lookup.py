"""The surface below a moving tip: asked seldom, right in between, the same however a record is cut."""

import numpy as np
import pytest
from palpate_engine.alignment.surface_lookup import SurfaceLookup
from palpate_surfaces import HalfEllipsoid, Mesh, Plane

from tests.surfaces.bodies import AXES, ellipsoid, half, write_body


class Asked:
    """A surface that counts its questions."""

    def __init__(self, surface):
        self.surface, self.count = surface, 0

    def nearest(self, places):
        self.count += 1
        return self.surface.nearest(places)


def sweep(surface, count=800, way=0.030, depth=0.004):
    """Places of a tip that is pressed in, and moved along a body while it is pressed by a sine."""
    lateral = np.column_stack([np.linspace(-way / 2, way / 2, count), np.full(count, 0.006)])
    points = surface.uppermost(lateral)
    height = -depth * np.sin(np.linspace(0.0, 20.0, count)) ** 2
    return points.position + height[:, None] * points.normal


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """The upper half of an ellipsoid."""
    file = write_body(tmp_path_factory.mktemp("mesh") / "breast.stl", *half(*ellipsoid()))
    return Mesh(file=file, position=(0.0, 0.0, -0.04))


DOME = HalfEllipsoid(half_axes=(0.06, 0.05, 0.04))
SMALL = HalfEllipsoid(half_axes=(0.02, 0.02, 0.02))


@pytest.mark.parametrize(
    ("surface", "height", "angle"), [(DOME, 0.1e-6, 1e-4), (SMALL, 1e-6, 1e-3), (Plane(tilt_x=0.2), 1e-15, 1e-12)]
)
def test_between_its_questions_it_is_the_surface(surface, height, angle):
    """The curvature is that of the last question: 0.5 mm of way."""
    places, asked = sweep(surface, way=0.030 if surface is not SMALL else 0.012), Asked(surface)
    points, own = surface.nearest(places), SurfaceLookup(asked).planes(places, len(places))
    assert asked.count < 100
    np.testing.assert_allclose(own.height, points.height, atol=height)
    np.testing.assert_allclose(own.normal, points.normal, atol=angle)
    np.testing.assert_allclose(own.curvature, points.curvature, rtol=0.1, atol=1e-9)
    assert (own.known == 1.0).all()


def test_between_its_questions_a_mesh_is_as_near_to_the_body(mesh):
    """Normals of a mesh jump where other vertices count, by more than is lost between two questions."""
    body = HalfEllipsoid(half_axes=tuple(AXES), centre=(0.0, 0.0, -0.04))
    places, asked = sweep(body, count=200), Asked(mesh)
    truth, points, own = body.nearest(places), mesh.nearest(places), SurfaceLookup(asked).planes(places, len(places))
    assert asked.count < 80
    np.testing.assert_allclose(own.height, truth.height, atol=5e-6)
    angle, least = (np.linalg.norm(some.normal - truth.normal, axis=1) for some in (own, points))
    assert angle.max() < 0.02
    assert np.sqrt((angle**2).mean()) < 1.3 * np.sqrt((least**2).mean())


@pytest.mark.parametrize("surface", [DOME, Plane(tilt_x=0.2)])
def test_a_press_is_one_question(surface):
    top = surface.uppermost(np.array([[0.012, 0.006]]))
    places = top.position + np.linspace(0.004, -0.006, 500)[:, None] * top.normal
    asked = Asked(surface)
    own = SurfaceLookup(asked).planes(places, len(places))
    assert asked.count == 1
    np.testing.assert_allclose(own.height, surface.nearest(places).height, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_record_may_be_cut_anywhere(seed):
    places = sweep(DOME)
    whole, cut, rng, row = (
        SurfaceLookup(DOME).planes(places, len(places)),
        SurfaceLookup(DOME),
        np.random.default_rng(seed),
        0,
    )
    while row < len(places):
        length, ahead = rng.integers(0, 40), rng.integers(0, 5)
        part = cut.planes(places[row : row + length + ahead], length)
        for key in ("normal", "height", "curvature", "curvature_std", "known"):
            np.testing.assert_array_equal(getattr(part, key), getattr(whole, key)[row : row + length + ahead])
        row += length


def test_beyond_the_rim_nothing_is_known(mesh):
    """Up to the rim it is known, as planes without their turn, where a part of what is around is not known."""
    z = np.concatenate([np.linspace(-0.037, -0.043, 121), np.linspace(-0.043, -0.037, 121)])
    places = np.column_stack([np.full_like(z, AXES[0]), np.zeros_like(z), z])
    known = SurfaceLookup(mesh).planes(places, len(places)).known == 1.0
    truth = np.array([row not in mesh.nearest(places).unknown for row in range(len(places))])
    assert truth.any()
    assert not truth.all()
    assert np.count_nonzero(known != truth) <= 4  # places 0.05 mm apart


def test_a_place_that_is_not_a_number_asks_nothing():
    places = sweep(DOME, count=9)
    places[4:6] = np.nan
    asked = Asked(DOME)
    own = SurfaceLookup(asked).planes(places, len(places))
    assert asked.count == 7
    assert np.isnan(own.height[4:6]).all()
    assert np.isfinite(np.delete(own.height, [4, 5])).all()
