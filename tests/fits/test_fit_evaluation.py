"""A fit with nothing free is an evaluation: what values that are known leave of a record."""

import numpy as np
import pytest
from palpate import Problem, Samples
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere, StandardLinearSolid

RADIUS, E, ETA, NOISE = 5e-3, 112.5e3, 362.0, 0.05


def press(speed=4e-3, deep=4e-3, rate=500.0, seed=0):
    """A press on a sphere by Hertz's law and the paper's damper, written out here; the surface is at 0."""
    n = round((1e-3 + deep) / speed * rate)
    stamp = np.arange(n, dtype=np.int64) * round(1e9 / rate)
    time = stamp / 1e9
    height = 1e-3 - speed * time
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * E * np.sqrt(RADIUS) * depth**1.5 + 8 * ETA * np.sqrt(RADIUS * depth) * speed
    force = force + NOISE * np.random.default_rng(seed).standard_normal(n)
    contact = depth > 0
    interval = np.concatenate([[0.0], np.diff(time)])
    return Samples(stamp, time, interval, force, height, np.full(n, -speed), contact, contact)


@pytest.mark.parametrize("solver", ["auto", "trf"])
@pytest.mark.parametrize("extra", [{}, {"bootstrap": 3}, {"systematic": {"radius": "20 um"}}], ids=str)
def test_with_everything_known_the_residual_is_the_noise(solver, extra):
    fixed = {"elasticity": E, "viscosity": ETA, "surface": 0.0}
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    estimates = CasadiFit(unknowns=(), fixed=fixed, solver=solver, **extra).start(Problem(model, None)).run(press())
    assert estimates.flags == ()
    assert estimates.details["rms"] == pytest.approx(NOISE, rel=0.1)
    assert estimates.values[-1].tolist() == [E, ETA]
    assert estimates.std[-1].tolist() == [0.0, 0.0]
    assert estimates.details["covariance"] == {"names": [], "matrix": []}


def test_a_contact_point_by_another_method_leaves_nothing_free():
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    fixed = {"elasticity": E, "viscosity": ETA}
    settings = CasadiFit(unknowns=(), fixed=fixed, contact_point="threshold", segment="all")
    estimates = settings.start(Problem(model, None)).run(press())
    assert estimates.details["covariance"]["names"] == []
    assert np.isfinite(estimates.details["rms"])


def test_a_model_that_remembers_is_evaluated_too():
    model = StandardLinearSolid(indenter=Sphere(radius=RADIUS))
    fixed = {"elasticity": 90e3, "relaxing_elasticity": 20e3, "relaxation_time": 0.3, "surface": 0.0}
    samples = press()
    estimates = CasadiFit(unknowns=(), fixed=fixed).start(Problem(model, None)).run(samples)
    assert np.isfinite(estimates.details["rms"])
