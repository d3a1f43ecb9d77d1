"""Thickness corrections: printed values, where they hold, and how speed enters."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_models import Cone, DimensionalityReduction, ExactSphere, Flat, Paraboloid, Quartic, Sphere
from palpate_models.thickness import Thickness

sys.path.insert(0, str(Path(__file__).parent))
from parts import THICKNESSES

R, H = 5e-3, 22e-3
every = pytest.mark.parametrize("thickness", THICKNESSES.values(), ids=THICKNESSES.keys())


def factor(thickness, tip, depth):
    corrected = DimensionalityReduction(indenter=tip, thickness=thickness)
    return corrected.force(depth, 0.0, [1.0, 0.0]) / DimensionalityReduction(indenter=tip).force(depth, 0.0, [1.0, 0.0])


@pytest.mark.parametrize("d", [1e-9, 1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("tip", [Sphere(radius=R), ExactSphere(radius=R), Paraboloid(curvature_radius=R)])
def test_dimitriadis_is_the_printed_polynomial(d, tip):
    x = math.sqrt(R * d) / H
    bonded = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
    free = 1 + 0.884 * x + 0.781 * x**2 + 0.386 * x**3 + 0.0048 * x**4
    assert factor(THICKNESSES["dimitriadis-bonded"], tip, d) == pytest.approx(bonded, rel=1e-12)
    assert factor(THICKNESSES["dimitriadis-free"], tip, d) == pytest.approx(free, rel=1e-12)


@pytest.mark.parametrize("d", [1e-9, 1e-4, 1e-3, 5e-3])
def test_garcia_is_the_printed_polynomial(d):
    garcia, x, b, t = THICKNESSES["garcia"], math.sqrt(R * d) / H, R / H, math.radians(30)
    sphere = 1 + 1.133 * x + 1.497 * x**2 + 1.469 * x**3 + 0.755 * x**4
    flat = 1 + 1.133 * b + 1.283 * b**2 + 0.598 * b**3 - 0.291 * b**4
    y = d / (math.tan(t) * H)
    cone = 1 + 0.721 * y + 0.650 * y**2 + 0.491 * y**3 + 0.225 * y**4
    assert factor(garcia, Sphere(radius=R), d) == pytest.approx(sphere, rel=1e-12)
    assert factor(garcia, Flat(radius=R), d) == pytest.approx(flat, rel=1e-12)
    assert factor(garcia, Cone(angle=t), d) == pytest.approx(cone, rel=1e-12)


@pytest.mark.parametrize("tip", [Sphere(radius=R), Flat(radius=R), Cone(angle=math.radians(30))])
def test_garcia_agrees_with_the_first_terms_of_the_theory(tip):
    # A rigid base lifts the whole contact by 1.133/(2 h) F/E*, for every tip, to second order in a/h.
    def lifted(depth):
        force = 0.0
        for _ in range(60):
            force = 2 * tip.profile_area(depth + 1.133 / (2 * 1.0) * force)
        return force / (2 * tip.profile_area(depth))

    depth, thick = 1e-5, 1.0
    size = tip.contact_radius(depth) / thick
    garcia = factor(Thickness(law="garcia", height=thick), tip, depth)
    assert garcia - 1 == pytest.approx(lifted(depth) - 1, rel=max(2 * size, 1e-3))


@pytest.mark.parametrize(
    ("law", "a", "b", "f", "g"),
    [
        ("cylinder-bonded", 0.768, 1.555, -0.267, -0.027),
        ("cylinder-free", 0.383, 0.617, -0.063, -0.032),
        ("cylinder-sticking", 0.576, 2.217, -0.039, 0.025),
    ],
)
def test_finite_cylinder_is_the_fitted_formula(law, a, b, f, g):
    d = 3e-3
    x, e = math.sqrt(R * d) / 22e-3, d / R
    expected = (1 - 0.15 * e) * (1 + a * x + b * x**2 + f * x * e + g * e)
    assert factor(THICKNESSES[law], Sphere(radius=R), d) == pytest.approx(expected, rel=1e-12)


@every
def test_viscous_force_is_the_derivative_of_the_corrected_elastic_one(thickness):
    # Correspondence: F = E P(d) + 3 eta P'(d) d' at nu = 0.5, so that a delay shifts eta by G for every correction.
    model = DimensionalityReduction(indenter=Sphere(radius=R), thickness=thickness)
    for d in (1e-6, 1e-3, 5e-3):
        slope = complex(model.force(d + 1e-30j, 0.0, [1.0, 0.0])).imag / 1e-30
        assert model.force(d, 1.0, [0.0, 1.0]) == pytest.approx(3 * slope, rel=1e-12)


@every
def test_correction_vanishes_for_a_thick_layer(thickness):
    thick = thickness.model_copy(update={"height": 1e6, "diameter": 1e6 * 50 / 22})
    tip = Sphere(radius=1e5) if thickness.law == "finite-cylinder" else Sphere(radius=R)
    assert thick.factor(tip, 1e-9)[0] == pytest.approx(1.0, abs=1e-4)


def test_a_range_that_is_left_is_said():
    model = DimensionalityReduction(indenter=ExactSphere(radius=R), thickness=THICKNESSES["dimitriadis-free"])
    assert model.validity(1e-3) == ""
    assert "23% of the layer's height" in model.validity(5e-3)
    wide = DimensionalityReduction(indenter=ExactSphere(radius=0.5), thickness=THICKNESSES["dimitriadis-free"])
    assert "contact radius is 1.5 of the layer" in wide.validity(2.2e-3)
    cylinder = DimensionalityReduction(indenter=Sphere(radius=R), thickness=THICKNESSES["cylinder-free"])
    assert cylinder.validity(5e-3) == ""
    assert "depths of 5 mm, not 6 mm" in cylinder.validity(6e-3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"thickness": {"law": "dimitriadis", "height": H}, "poisson": 0.4}, "poisson = 0.5, not 0.4"),
        ({"thickness": {"law": "dimitriadis", "height": H}, "indenter": Flat(radius=R)}, "try garcia"),
        ({"thickness": {"law": "dimitriadis", "height": H}, "indenter": Quartic()}, "no correction is known"),
        ({"thickness": {"law": "garcia", "height": H, "bonded": False}}, "garcia is for a bonded layer"),
        ({"thickness": {"law": "finite-cylinder", "height": H}}, "needs the diameter"),
        ({"thickness": {"law": "finite-cylinder", "height": H, "diameter": H}}, "diameter/height 2.27"),
        (
            {
                "thickness": {"law": "finite-cylinder", "height": H, "diameter": 50e-3},
                "indenter": ExactSphere(radius=R),
            },
            "for the tip 'sphere'",
        ),
        (
            {"thickness": {"law": "finite-cylinder", "height": H, "diameter": 50e-3}, "indenter": Sphere(radius=1e-3)},
            "radii of 2 to 10 mm",
        ),
        ({"thickness": {"law": "dimitriadis", "height": H, "diameter": 1.0}}, "belong to finite-cylinder"),
    ],
)
def test_a_correction_that_is_not_known_is_refused(settings, words):
    with pytest.raises(ConfigurationError, match=words):
        DimensionalityReduction(**{"indenter": Sphere(radius=R)} | settings)


def test_none_is_a_half_space_and_a_radius_makes_any_tip_a_sphere():
    assert DimensionalityReduction(indenter=Sphere(radius=R), thickness="none").thickness is None
    like = Thickness(law="dimitriadis", height=H, radius=R)
    assert factor(like, Quartic(), 1e-3) == pytest.approx(
        factor(THICKNESSES["dimitriadis-bonded"], Sphere(radius=R), 1e-3), rel=1e-12
    )
    np.testing.assert_allclose(like.factor(Quartic(), np.array([1e-3]))[0], like.factor(Quartic(), 1e-3)[0])


@pytest.mark.parametrize("law", ["garcia", "dimitriadis"])
@pytest.mark.parametrize("tip", [Sphere(radius=R), ExactSphere(radius=R), Flat(radius=R), Cone(angle=0.3)])
def test_other_layers_are_laws_that_are_known_for_the_tip(tip, law):
    """Deeper than a tenth of the height: the laws of spheres are no alternatives under a cone or a flat tip."""
    is_sphere = isinstance(tip, Sphere | ExactSphere)
    if law == "dimitriadis" and not is_sphere:
        with pytest.raises(ConfigurationError, match="for spheres"):
            DimensionalityReduction(indenter=tip, thickness={"law": law, "height": "22 mm"})
        return
    model = DimensionalityReduction(indenter=tip, thickness={"law": law, "height": "22 mm"})
    others = model.other_geometries(3e-3, [1e5, 100.0])
    published = {"garcia": "dimitriadis", "dimitriadis": "garcia"}[law]
    assert set(others) == ({published, "finite-cylinder"} if is_sphere else set())
    assert all(np.isfinite(values).all() for values in others.values())
