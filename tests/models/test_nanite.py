"""An independent check: forces of nanite (GPL; imported here and nowhere else)."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from palpate_models import Cone, DimensionalityReduction, ExactSphere, Paraboloid

E, R = 3e3, 10e-6
ratios = pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])


@pytest.fixture(scope="module")
def nanite():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("nanite.model", reason="nanite is not installed")


def force(tip, depth, nu):
    return DimensionalityReduction(indenter=tip, poisson=nu).force(depth, 0.0, [E, 0.0])


@ratios
@pytest.mark.parametrize("opening", [10.0, 25.0, 70.0])
def test_cone(nanite, nu, opening):
    depth = np.linspace(1e-8, 5e-6, 50)
    theirs = nanite.model_conical_indenter.hertz_conical(-depth, E=E, alpha=opening, nu=nu)
    tip = Cone(angle=math.radians(90 - opening))  # they count from the axis
    np.testing.assert_allclose(force(tip, depth, nu), theirs, rtol=1e-12)


@ratios
def test_paraboloid(nanite, nu):
    depth = np.linspace(1e-8, 5e-6, 50)
    theirs = nanite.model_hertz_paraboloidal.hertz_paraboloidal(-depth, E=E, R=R, nu=nu)
    np.testing.assert_allclose(force(Paraboloid(curvature_radius=R), depth, nu), theirs, rtol=1e-12)


@ratios
def test_exact_sphere_within_what_their_series_promises(nanite, nu):
    # Their truncated power series documents an error more than four magnitudes below the force.
    depth = np.linspace(1e-8, R, 200)
    theirs = nanite.model_sneddon_spherical_approximation.hertz_sneddon_spherical_approx(-depth, E=E, R=R, nu=nu)
    np.testing.assert_allclose(force(ExactSphere(radius=R), depth, nu), theirs, rtol=1e-4)
