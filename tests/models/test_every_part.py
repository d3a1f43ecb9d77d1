"""What holds of every tip and every model, shipped now or later."""

from __future__ import annotations

import inspect
import re
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from palpate import Indenter, contact_force
from palpate.units import to_si
from palpate_filters.ekf import ExtendedKalmanFilter
from palpate_models import Cone, DimensionalityReduction, Flat, Paraboloid, Quartic, Sphere, TiltedFlat
from palpate_testing import check_estimator, check_indenter, check_model

sys.path.insert(0, str(Path(__file__).parent))
from parts import MODELS, THICKNESSES, TIPS

DEPTHS = np.geomspace(1e-6, 6e-3, 40)
tips = pytest.mark.parametrize("tip", TIPS.values(), ids=TIPS.keys())
models = pytest.mark.parametrize(("model", "theta"), MODELS.values(), ids=MODELS.keys())


@tips
def test_tip_conforms(tip: Indenter):
    check_indenter(tip)


@tips
def test_profile_area_is_the_default_integral_of_the_contact_radius(tip):
    # Exact for powers d^(k/4); elsewhere it is a quadrature over the whole depth, which feels where two shapes meet.
    closed, quadrature = tip.profile_area(DEPTHS), Indenter.profile_area(tip, DEPTHS)
    tolerance = 1e-12 if isinstance(tip, Cone | Flat | Paraboloid | Quartic | Sphere) else 2e-3
    if isinstance(tip, TiltedFlat):
        tolerance = 1e-2  # two shapes meet with a kink
    np.testing.assert_allclose(quadrature, closed, rtol=tolerance)


@tips
def test_derivative_of_area_is_exact_by_casadi_too(tip):
    import casadi

    d = casadi.SX.sym("d")
    slope = casadi.Function("s", [d], [casadi.jacobian(tip.profile_area(d), d)])
    found = np.array([float(slope(x)) for x in DEPTHS])
    np.testing.assert_allclose(found, tip.contact_radius(DEPTHS), rtol=1e-9)


@models
def test_model_conforms(model, theta):
    check_model(model, theta)


@models
def test_force_at_touch_is_finite_with_a_finite_jacobian(model, theta):
    import casadi

    state = casadi.SX.sym("s", 2)
    force = contact_force(model, state[0], state[1], theta, [0.0] * len(model.memory))
    slope = casadi.Function("j", [state], [force, casadi.jacobian(force, state)])
    for value in slope([0.0, 0.01]):
        assert np.isfinite(np.array(value)).all()


@models
def test_parameters_carry_all_that_an_estimator_asks_for(model, theta):
    for parameter in model.parameters:
        assert parameter.symbol
        assert parameter.meaning
        assert parameter.start is not None
        assert parameter.start_std > 0
        assert parameter.lower < parameter.start < parameter.upper
        assert to_si(parameter.start, parameter.unit) == parameter.start


def test_one_name_one_symbol_one_unit_over_all_models():
    seen = defaultdict(set)
    for model, _ in MODELS.values():
        for parameter in model.parameters:
            seen[parameter.name].add((parameter.symbol, parameter.unit))
            seen[parameter.symbol].add(parameter.name)
    assert {key: found for key, found in seen.items() if len(found) > 1} == {}


@models
def test_material_gradient_is_its_derivative(model, theta):
    for i, value in enumerate(model.material(theta)):
        for j, number in enumerate(theta):
            moved = list(theta)
            moved[j] = number * (1 + 1e-6)
            slope = (model.material(moved)[i].value - value.value) / (number * 1e-6)
            assert slope == pytest.approx(value.gradient[j], rel=1e-5, abs=1e-9)


def test_material_says_what_it_can():
    said = {name: {value.name for value in model.material(theta)} for name, (model, theta) in MODELS.items()}
    both = {"elasticity", "viscosity"}
    assert said == {
        "dimensionality-reduction": both,
        "standard-linear-solid": both,
        "dimensionality-reduction-maxwell": both | {"instant_elasticity"},
        "maxwell": both,
        "generalised-maxwell-2": {"elasticity", "instant_elasticity"},
        "generalised-maxwell-3": {"elasticity", "instant_elasticity"},
        "generalised-maxwell-4": {"elasticity", "instant_elasticity"},
        "burgers": both,
        "power-law": {"elasticity"},
        "fractional-kelvin-voigt": {"elasticity"},
        "poroelastic": {"elasticity", "instant_elasticity"},
        "kelvin-voigt": both,
        "hunt-crossley": {"elasticity"},
        "hunt-crossley-free": {"elasticity"},
        "fung": both,
        "two-layers": both,
        "two-layers-free": both,
        "compression": {"elasticity"},
        "dmt": {"elasticity"},
        "jkr": {"elasticity"},
    }


@pytest.mark.parametrize("part", [type(p) for p in (*TIPS.values(), *(m for m, _ in MODELS.values()))])
def test_docstring_is_to_the_standard_of_the_field(part):
    text = inspect.getdoc(part)
    summary, _, rest = text.partition("\n")
    assert summary.endswith((".", "]", ")")), summary
    assert "Source:" in rest or "Source:" in text
    assert re.search(r"\b(19|20|18)\d\d\b|paper", text), "no literature"
    for name, field in part.model_fields.items():
        assert field.description, name


@pytest.mark.parametrize("thickness", THICKNESSES.values(), ids=THICKNESSES.keys())
def test_docstring_of_a_correction_says_how_speed_is_treated(thickness):
    text = " ".join(inspect.getdoc(type(thickness)).split())
    assert thickness.law in text
    assert "None of the sources treats speed" in text


@pytest.mark.parametrize("thickness", [None, THICKNESSES["dimitriadis-free"]], ids=["half-space", "layer"])
@tips
def test_jacobian_is_finite_at_and_around_touch_under_every_tip(tip, thickness):
    import casadi

    if thickness is not None:
        thickness = thickness.model_copy(update={"radius": 5e-3})
    model = DimensionalityReduction(indenter=tip, thickness=thickness)
    state = casadi.SX.sym("s", 4)
    force = contact_force(model, *casadi.vertsplit(state[:2]), casadi.vertsplit(state[2:]))
    slopes = casadi.Function("j", [state], [force, casadi.jacobian(force, state)])
    for depth in (-1e-3, -1e-12, 0.0, 1e-12, 1e-6, 6e-3, 0.1):
        for number in slopes([depth, 0.01, 1e5, 300.0]):
            assert np.isfinite(np.array(number)).all(), depth


def marks_of(name, model):
    """Models that remember are slow; one of them stands for all in the gate."""
    return [pytest.mark.slow, *([pytest.mark.gate] if name == "standard-linear-solid" else [])] if model.memory else []


@pytest.mark.parametrize(
    ("model", "theta"),
    [pytest.param(*part, id=name, marks=marks_of(name, part[0])) for name, part in MODELS.items()],
)
def test_the_papers_filter_keeps_its_promises_with_every_model(model, theta):
    check_estimator(ExtendedKalmanFilter(), model, theta)
