"""States of models with memory along a record in a fit: right at any interval, and never off to infinity."""

import numpy as np
import pytest
from palpate import force_over_time
from palpate_fits.record_arrays import make_record
from palpate_fits.residual import Residual
from palpate_models import (
    Burgers,
    DimensionalityReductionMaxwell,
    GeneralisedMaxwell3,
    Poroelastic,
    PowerLaw,
    Sphere,
    StandardLinearSolid,
)

TIP = Sphere(radius=5e-3)
MODELS = [
    (StandardLinearSolid(indenter=TIP), (1e5, 5e4, 0.2)),
    (DimensionalityReductionMaxwell(indenter=TIP), (1e5, 200.0, 5e4, 0.4)),
    (GeneralisedMaxwell3(indenter=TIP), (1e5, 4e4, 0.03, 3e4, 0.3, 2e4, 9.0)),
    (Burgers(indenter=TIP), (150e3, 200e3, 300e3, 10e3)),
    (PowerLaw(indenter=TIP), (1e5, 0.15)),
    (Poroelastic(indenter=TIP), (1e5, 0.2, 5e-6)),
]


def fitted_force(model, theta, step):
    """Times, and the force that a fit has along a press and a sine in intervals of `step` [s]."""
    fine = np.arange(0, 3.0, step / 8)
    s = np.clip((fine - 0.2) / 0.5, 0, 1)
    depth = -1e-3 + 4e-3 * s**3 * (10 - 15 * s + 6 * s**2) + 5e-4 * np.sin(4 * np.pi * fine) * s**3
    rate = np.gradient(depth, fine)
    true = force_over_time(model, fine, depth, rate, theta)[::8]
    time = fine[::8]
    columns = (-depth[::8], rate[::8], 0 * time, 0 * time, time, np.ones(len(time)))
    residual, x = Residual(model, ()), np.array([*theta, 0.0, 0.0, 0.0, 0.0, 0.0])
    blocks = residual.blocks(make_record(columns, 1e-6), x)
    return np.concatenate([values[:, 0] for _, values in blocks]), true


@pytest.mark.parametrize(("model", "theta"), MODELS, ids=lambda value: type(value).__name__)
def test_the_force_is_that_of_the_simulation(model, theta):
    """Against Runge and Kutta at steps of an eighth of the interval; what is left is depth between the samples."""
    found, true = fitted_force(model, theta, 2e-3)
    assert np.abs(found - true).max() < 2e-3 * true.max()


@pytest.mark.parametrize(("model", "theta"), MODELS[-2:], ids=lambda value: type(value).__name__)
def test_a_slow_record_stays_finite(model, theta):
    """At 50 Hz the fastest arms fade in a hundredth of an interval: the classic step would leave for infinity."""
    found, true = fitted_force(model, theta, 2e-2)
    assert np.abs(found - true).max() < 5e-2 * true.max()
