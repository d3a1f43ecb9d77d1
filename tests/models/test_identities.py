"""Forces against closed forms of the literature, over a wide range of radius, depth and Poisson's ratio."""

from __future__ import annotations

import math

import numpy as np
import pytest
from palpate_models import (
    BluntCone,
    Cone,
    DimensionalityReduction,
    Ellipsoid,
    ExactSphere,
    Flat,
    Paraboloid,
    Power,
    Quartic,
    Sphere,
    TruncatedCone,
)
from palpate_models.indenters.power_profiles import hess_factor

E, ETA = 112.5e3, 362.0
RELATIVE = np.geomspace(1e-6, 2.0, 50)  # depth over radius
radii = pytest.mark.parametrize("R", [1e-6, 2.5e-3, 5e-3, 1.0])
ratios = pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])


def elastic(tip, depth, nu):
    return DimensionalityReduction(indenter=tip, poisson=nu).force(depth, 0.0, [E, ETA])


def reduced(nu):
    return E / (1 - nu**2)


@radii
@ratios
def test_paraboloid_is_hertz(R, nu):
    d = RELATIVE * R
    hertz = 4 / 3 * reduced(nu) * math.sqrt(R) * d**1.5
    for tip in (Sphere(radius=R), Power(exponent=2, coefficient=1 / (2 * R)), Paraboloid(curvature_radius=R)):
        np.testing.assert_allclose(elastic(tip, d, nu), hertz, rtol=1e-12)


@radii
@ratios
def test_flat_is_boussinesq(R, nu):
    d = RELATIVE * R
    np.testing.assert_allclose(elastic(Flat(radius=R), d, nu), 2 * R * reduced(nu) * d, rtol=1e-12)


@pytest.mark.parametrize("degrees", [1, 20, 45, 80])
@ratios
def test_cone_is_sneddon(degrees, nu):
    t, d = math.radians(degrees), np.geomspace(1e-9, 1e-2, 40)
    sneddon = 2 / math.pi * reduced(nu) * d**2 / math.tan(t)
    for tip in (Cone(angle=t), Power(exponent=1, coefficient=math.tan(t))):
        np.testing.assert_allclose(elastic(tip, d, nu), sneddon, rtol=1e-12)


@ratios
def test_quartic_is_the_papers(nu):
    # The paper's eq. x4 by MDR: g = (8/3) c x^4, F = (8/5) E* (3/(8 c))^(1/4) d^(5/4).
    c, d = 1e7, np.geomspace(1e-7, 1e-2, 40)
    expected = 1.6 * reduced(nu) * (3 / (8 * c)) ** 0.25 * d**1.25
    for tip in (Quartic(coefficient=c), Power(exponent=4, coefficient=c)):
        np.testing.assert_allclose(elastic(tip, d, nu), expected, rtol=1e-12)


def test_hess_factors():
    assert [hess_factor(n) for n in (1, 2, 4)] == pytest.approx([math.pi / 2, 2.0, 8 / 3], rel=1e-15)


@radii
@ratios
def test_exact_sphere_is_its_closed_form(R, nu):
    d = RELATIVE * R
    tip = ExactSphere(radius=R)
    a = tip.contact_radius(d)
    root = a / 2 * 2 * np.arctanh(a / R)
    np.testing.assert_allclose(root, d, rtol=1e-9)
    deep = RELATIVE > 1e-3  # the printed form loses digits to cancellation below
    closed = reduced(nu) * ((a**2 + R**2) * np.arctanh(a / R) - a * R)
    np.testing.assert_allclose(elastic(tip, d, nu)[deep], closed[deep], rtol=1e-9)
    shallow = RELATIVE < 1e-4
    hertz = elastic(Sphere(radius=R), d, nu)
    # F/F_Hertz = 1 - d/(10 R) + O((d/R)^2)
    expected = 1 - RELATIVE / 10
    np.testing.assert_allclose((elastic(tip, d, nu) / hertz)[shallow], expected[shallow], rtol=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.95])
def test_exact_sphere_is_the_mdr_integral_of_its_profile(share):
    from scipy.integrate import quad

    R = 5e-3
    a = share * R

    def reduced_profile(x):  # r = x sin p
        return x * quad(lambda p: x * math.sin(p) / math.sqrt(R**2 - (x * math.sin(p)) ** 2), 0, math.pi / 2)[0]

    d = reduced_profile(a)
    area = quad(lambda x: d - reduced_profile(x), 0, a, epsabs=0, epsrel=1e-12)[0]
    tip = ExactSphere(radius=R)
    assert tip.contact_radius(d) == pytest.approx(a, rel=1e-9)
    assert tip.profile_area(d) == pytest.approx(area, rel=1e-9)


def test_exact_sphere_docstring_numbers():
    R = 5e-3
    for relative, lower in ((0.01, 0.001), (0.1, 0.01), (1.0, 0.1)):
        d = relative * R
        ratio = ExactSphere(radius=R).profile_area(d) / Sphere(radius=R).profile_area(d)
        assert 1 - ratio == pytest.approx(lower, rel=0.1)


@radii
def test_ellipsoid_with_equal_axes_is_a_sphere(R):
    d = RELATIVE * R
    np.testing.assert_allclose(
        elastic(Ellipsoid(radius=R, height=R), d, 0.5), elastic(ExactSphere(radius=R), d, 0.5), rtol=1e-12
    )


def test_slender_ellipsoid_is_a_paraboloid_at_its_apex():
    b, c = 3e-3, 9e-3
    d = 1e-6 * c
    hertz = elastic(Paraboloid(curvature_radius=b**2 / c), d, 0.5)
    assert elastic(Ellipsoid(radius=b, height=c), d, 0.5) == pytest.approx(hertz, rel=1e-6)


@pytest.mark.parametrize("degrees", [1, 20, 60, 85])
def test_truncated_cone_solves_its_equation_and_has_its_limits(degrees):
    t, b = math.radians(degrees), 1e-3
    tip = TruncatedCone(angle=t, face_radius=b)
    d = np.geomspace(1e-9, 1.0, 60) * b * math.tan(t) * 100
    a = tip.contact_radius(d)
    s = np.sqrt((a / b - 1) * (a / b + 1))
    shallow = d < 1e-2 * b * math.tan(t)  # s is ill-conditioned near a = b
    np.testing.assert_allclose((a * math.tan(t) * np.arctan(s))[~shallow], d[~shallow], rtol=1e-10)
    assert tip.profile_area(1e-9 * b) == pytest.approx(Flat(radius=b).profile_area(1e-9 * b), rel=1e-6)
    far = 1e6 * b * math.tan(t)
    assert tip.profile_area(far) == pytest.approx(Cone(angle=t).profile_area(far), rel=1e-5)


@pytest.mark.parametrize("degrees", [1, 20, 60, 85, 88])
def test_blunt_cone_is_a_sphere_then_solves_its_equation(degrees):
    t, R = math.radians(degrees), 1e-3
    tip, sphere = BluntCone(angle=t, tip_radius=R), ExactSphere(radius=R)
    inside = tip.sphere_depth * np.array([1e-6, 1e-3, 0.5, 0.999999])
    np.testing.assert_allclose(tip.profile_area(inside), sphere.profile_area(inside), rtol=1e-12)
    d = tip.sphere_depth * np.geomspace(1.0001, 1e4, 50)
    a, b = tip.contact_radius(d), R * math.sin(t)
    s = np.sqrt((a / b) ** 2 - 1)
    own = a * (np.log((R + a) / (R * math.cos(t) + b * s)) + math.tan(t) * np.arctan(s))
    np.testing.assert_allclose(own, d, rtol=1e-9)
    jump = tip.profile_area(tip.sphere_depth * (1 + 1e-12)) / tip.profile_area(tip.sphere_depth)
    assert jump == pytest.approx(1.0, abs=1e-9)


def test_viscous_force_is_four_eta_over_one_minus_nu_times_contact_radius():
    tip, nu, d = ExactSphere(radius=5e-3), 0.3, 2e-3
    model = DimensionalityReduction(indenter=tip, poisson=nu)
    viscous = model.force(d, 0.01, [E, ETA]) - model.force(d, 0.0, [E, ETA])
    assert viscous == pytest.approx(4 * ETA / (1 - nu) * tip.contact_radius(d) * 0.01, rel=1e-12)
