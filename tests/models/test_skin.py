"""Contact models on a skin that is inclined or curved, against closed forms and Hertz's elliptic contact."""

import math

import numpy as np
import pytest
from palpate.contact.sensitivity import force_slopes
from palpate.errors import ConfigurationError
from palpate.parts import numbers_of
from palpate_kit.budget.uncertainty_sources import sources_of
from palpate_models import (
    Cone,
    DimensionalityReduction,
    ExactSphere,
    Flat,
    Poroelastic,
    Quartic,
    Sphere,
    StandardLinearSolid,
)
from palpate_models.skin import ContactGeometry, Skin

R, THETA = 5e-3, (112.5e3, 362.0)
TIP = Sphere(radius=R)


def on(tip=TIP, **skin):
    return DimensionalityReduction(indenter=tip, skin=skin)


def share(depth=3e-3, tip=TIP, rate=0.0, **skin):
    level = DimensionalityReduction(indenter=tip).force(depth, rate, THETA)
    return on(tip, **skin).force(depth, rate, THETA) / level


@pytest.mark.parametrize("rate", [0.0, 10e-3])
@pytest.mark.parametrize("degrees", [5, 10, 15, 20, 30])
def test_an_inclined_sphere_slides_and_sticks_as_mindlin_says(degrees, rate):
    """cos^2.5 where it slides, cos^0.5 (cos^2 + 2/3 sin^2) where it sticks; the viscous part by the same factor."""
    t = math.radians(degrees)
    slides, sticks = math.cos(t) ** 2.5, math.cos(t) ** 0.5 * (math.cos(t) ** 2 + 2 / 3 * math.sin(t) ** 2)
    assert share(inclination=t, stick=0.0, rate=rate) == pytest.approx(slides, rel=1e-12)
    assert share(inclination=t, stick=1.0, rate=rate) == pytest.approx(sticks, rel=1e-12)
    assert share(inclination=t, rate=rate) == pytest.approx((slides + sticks) / 2, rel=1e-12)


@pytest.mark.parametrize(
    ("radius", "sphere", "cylinder"),
    [
        (0.1, -2.4, -1.2),
        (0.05, -4.7, -2.3),
        (0.025, -8.7, -4.4),
        (-0.1, 2.6, 1.3),
        (-0.05, 5.4, 2.7),
        (-0.025, 11.8, 5.7),
    ],
)
def test_curvature_makes_it_softer_on_a_bulge_and_stiffer_in_a_hollow(radius, sphere, cylinder):
    """Numbers of the elliptic Hertz contact, in per cent."""
    assert 100 * (share(skin_radius=radius) - 1) == pytest.approx(sphere, abs=0.06)
    assert 100 * (share(skin_radius=radius, skin_radius_across="flat") - 1) == pytest.approx(cylinder, abs=0.07)
    turned = share(skin_radius="flat", skin_radius_across=radius)
    assert turned == pytest.approx(share(skin_radius=radius, skin_radius_across="flat"), rel=1e-12)


@pytest.mark.parametrize(
    "tip", [TIP, ExactSphere(radius=R), Quartic(), Cone(angle=0.3)], ids=lambda tip: type(tip).__name__
)
@pytest.mark.parametrize("radius", [0.08, -0.08])
def test_the_area_is_the_integral_of_the_profile_with_the_curvature_added(tip, radius):
    """A(d) = int_0^a (d - g - x^2/R_s) dx, with g(x) from the tip's own contact radius and g + x^2/R_s = d at a."""
    from scipy.integrate import simpson
    from scipy.optimize import brentq

    depth, own = 3e-3, lambda x: brentq(lambda d: float(tip.contact_radius(d)) - x, 0.0, 1.0)
    skin = on(tip, skin_radius=radius).skin
    along, across = skin.curvatures
    rounded = float(tip.contact_radius(depth)) ** 2 / depth
    added = ((1 / rounded + along) * (1 / rounded + across)) ** 0.5 - 1 / rounded
    edge = brentq(lambda x: own(x) + added * x**2 - depth, 1e-6, float(tip.contact_radius(3 * depth)))
    area, contact = skin.contact(tip, None, 0.5, depth)
    places = np.linspace(0.0, edge, 101)
    gap = [depth - own(x) - added * x**2 if x else depth for x in places.tolist()]
    assert contact == pytest.approx(edge, rel=1e-6)
    assert area == pytest.approx(simpson(gap, x=places), rel=1e-4)


LAYER = {"law": "dimitriadis", "height": "22 mm"}


@pytest.mark.parametrize("radii", [(0.05, 0.05), (0.03, 0.09), (-0.04, 0.1)])
@pytest.mark.parametrize(
    ("tip", "thickness"), [(TIP, None), (TIP, LAYER), (ExactSphere(radius=R), None), (Quartic(coefficient=1e7), None)]
)
def test_the_share_of_a_curved_skin_is_that_of_the_same_skin_stated(tip, thickness, radii):
    depth = np.array([1e-4, 1e-3, 4e-3])
    level = DimensionalityReduction(indenter=tip, thickness=thickness)
    stated = level.model_copy(update={"skin": Skin(skin_radius=radii[0], skin_radius_across=radii[1])})
    shares = level.curved_share(np.tile(1 / np.array(radii), (3, 1)), depth)
    np.testing.assert_allclose(shares, stated.force(depth, 0.0, THETA) / level.force(depth, 0.0, THETA), rtol=1e-12)
    assert stated.curved_share(np.zeros((3, 2)), depth) is None


def test_the_share_is_told_where_it_is_known():
    curvature, depth = np.array([[0.0, 0.0], [20.0, 20.0], [-250.0, 0.0]]), np.full(3, 1e-3)
    shares = StandardLinearSolid(indenter=TIP).curved_share(curvature, depth)
    assert shares[:2] == pytest.approx([1.0, 1.1**-0.5], rel=1e-12)
    assert np.isnan(shares[2])  # a hollow that is narrower than the tip
    assert DimensionalityReduction(indenter=Flat(radius=R)).curved_share(curvature, depth) is None
    assert Poroelastic(indenter=TIP).curved_share(curvature, depth) is None


def test_a_skin_that_is_stated_level_and_flat_has_the_force_of_none():
    depth = np.linspace(1e-4, 5e-3, 50)
    np.testing.assert_array_equal(
        on().force(depth, 1e-3, THETA), DimensionalityReduction(indenter=TIP).force(depth, 1e-3, THETA)
    )


def test_on_a_bulge_the_normal_turns_away_as_the_tip_goes_in():
    """Two spheres: d_n = L - |c|, and the angle at the centre of the skin's, from their triangle."""
    t, radius, depth = math.radians(20), 0.03, 3e-3
    skin = on(inclination=t, skin_radius=radius).skin
    centre = np.array([radius * math.sin(t), 0.0])  # of the tip's, beside the axis through the skin's
    touch = math.sqrt((R + radius) ** 2 - centre[0] ** 2)
    angle = math.atan2(centre[0], touch - depth)
    assert skin.inclination_at(TIP, depth) == pytest.approx(angle, rel=1e-12)
    into = R + radius - math.hypot(centre[0], touch - depth)
    area, _ = on(inclination=t, skin_radius=radius, stick=0.0).skin.contact(TIP, None, 0.5, depth)
    plain, _ = on(skin_radius=radius).skin.contact(TIP, None, 0.5, into)
    assert area == pytest.approx(plain * math.cos(angle), rel=1e-12)


def test_the_expression_has_finite_derivatives_in_and_out_of_contact():
    model = on(ExactSphere(radius=R), inclination="30 deg", skin_radius="15 mm", skin_radius_across="-40 mm")
    depth = np.array([-1e-3, 0.0, 1e-6, 1e-3, 5e-3])
    for table in force_slopes(model, depth, np.full(5, 1e-3), THETA):
        assert np.isfinite(table).all()
    force, _, by_depth, _ = force_slopes(model, depth, np.zeros(5), THETA)
    step = 1e-7
    up, down = (float(model.force(1e-3 + side, 0.0, THETA)) for side in (step, -step))
    assert by_depth[3] == pytest.approx((up - down) / (2 * step), rel=1e-5)
    assert force[3] == pytest.approx(float(model.force(1e-3, 0.0, THETA)), rel=1e-12)


def test_a_material_that_relaxes_has_the_same_geometry():
    skin = {"inclination": 0.3, "skin_radius": 0.05}
    plain, tilted = (
        StandardLinearSolid.model_validate({"indenter": TIP, "skin": one}).force(3e-3, 0.0, (1e5, 2e4, 0.1))
        for one in (None, skin)
    )
    assert tilted / plain == pytest.approx(share(**skin), rel=1e-12)


@pytest.mark.parametrize(
    ("tip", "skin", "word"),
    [
        (TIP, {"skin_radius": "-4 mm"}, "too narrow"),
        (TIP, {"skin_radius": "0 mm"}, 'write "flat"'),
        (TIP, {"inclination": "50 deg"}, "less than or equal"),
        (TIP, {"skin_radius": "flatt"}, "did you mean 'flat'"),
        (TIP, {"skin_radius": "50"}, "no unit"),
        (TIP, {"inclination": "5 mm"}, "is a length"),
        (Flat(radius=R), {"skin_radius": "50 mm"}, "rounded tips"),
    ],
)
def test_a_skin_that_no_tip_can_touch_is_refused(tip, skin, word):
    with pytest.raises(ConfigurationError, match=word):
        on(tip, **skin)


def test_a_gel_knows_of_a_level_flat_half_space_only():
    with pytest.raises(ConfigurationError, match="without thickness and skin"):
        Poroelastic(indenter=TIP, skin={"inclination": "5 deg"})


@pytest.mark.parametrize("tip", [Flat(radius=R), Cone(angle=0.3), Quartic()], ids=lambda tip: type(tip).__name__)
def test_an_inclination_is_known_under_spheres_only(tip):
    assert "inclined" in on(tip, inclination="5 deg").validity(1e-3)
    assert not on(TIP, inclination="5 deg").validity(1e-3)
    assert not on(tip).validity(1e-3)


def test_a_contact_that_is_large_against_the_skin_is_said():
    assert "of the skin's radius" in on(skin_radius="8 mm").validity(3e-3)
    assert not on(skin_radius="50 mm").validity(3e-3)


def test_what_is_not_declared_of_a_stated_skin_has_a_default():
    model = on(inclination="20 deg", skin_radius="50 mm")
    units = {".".join(path): unit for path, _, unit in numbers_of(model)}
    assert units["skin.inclination"] == "rad"
    assert units["skin.skin_radius"] == "m"
    found = {source.name: source for source in sources_of(model, {"skin_radius": "1 mm"})}
    assert found["inclination"].std == pytest.approx(math.radians(2.0))
    assert (found["skin_radius"].std, found["skin_radius"].declared) == (1e-3, True)
    assert found["stick"].std == 0.5
    assert "stick" not in {source.name for source in sources_of(on(skin_radius="50 mm"), {})}


@pytest.mark.parametrize("radius", [0.05, 0.025, -0.05])
@pytest.mark.parametrize("tip", [TIP, Cone(angle=0.3), Quartic(coefficient=1e7)], ids=["paraboloid", "cone", "quartic"])
def test_under_a_layer_the_viscous_force_is_the_derivative_of_the_elastic_one(tip, radius):
    """The factor is that of the tip at the depth u of its own profile, whose du/dd is not u/d but for a paraboloid."""
    thickness = {"law": "garcia", "height": "22 mm", "radius": "5 mm"}
    geometry = ContactGeometry.of(
        DimensionalityReduction(indenter=tip, thickness=thickness, skin={"skin_radius": radius})
    )
    depth, step = 1e-3, 1e-9
    above, below = (float(geometry.contact(depth + sign * step)[0]) for sign in (1, -1))
    assert float(geometry.contact(depth)[1]) == pytest.approx((above - below) / (2 * step), rel=1e-5)
