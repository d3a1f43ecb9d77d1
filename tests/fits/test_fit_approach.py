"""A long approach in the fitted samples does not move the estimate."""

import numpy as np
import pytest
from palpate import Problem, Samples
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere

RADIUS, E, ETA, NOISE, SPEED = 5e-3, 112.5e3, 362.0, 0.05, 4e-3


def press(approach, rate=500.0):
    """Down through air at 40 mm/s, then 4 mm deep at 4 mm/s; force by Hertz and the paper's damper."""
    random = np.random.default_rng(0)
    air = approach - np.arange(0.0, approach, 40e-3 / rate)
    height = np.concatenate([air, -np.arange(0.0, 4e-3, SPEED / rate)])
    rise = np.where(height > 0, 0.0, SPEED)
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * E * np.sqrt(RADIUS) * depth**1.5 + 8 * ETA * np.sqrt(RADIUS * depth) * rise
    force = force + NOISE * random.standard_normal(len(height))
    stamp = np.arange(len(height), dtype=np.int64) * round(1e9 / rate)
    time = stamp / 1e9
    measured = height + 5e-6 * random.standard_normal(len(height))
    velocity = np.where(height > 0, -40e-3, -SPEED)
    return Samples(stamp, time, np.diff(time, prepend=0.0), force, measured, velocity, depth > 0, depth > 0)


@pytest.mark.parametrize("approach", [60e-3, 200e-3])
def test_all_samples_give_what_those_in_contact_give(approach):
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    fixed = {"viscosity": ETA}
    samples = press(approach)
    found = [
        CasadiFit(segment=segment, unknowns=(), fixed=fixed, profile=False).start(Problem(model, None)).run(samples)
        for segment in ("all", "contact")
    ]
    whole, contact = (fit.values[-1][0] for fit in found)
    assert whole == pytest.approx(E, abs=3 * found[0].std[-1][0])
    assert whole == pytest.approx(contact, rel=0.004)
