"""Motion is no noise: neither a sine of few samples a period, nor the step from one stretch to the next."""

import numpy as np
import palpate
import pytest
from palpate_fits import CasadiFit
from palpate_models import Sphere

ELASTICITY, VISCOSITY, RADIUS = 112.5e3, 362.0, 5e-3


@pytest.mark.parametrize("noise", [0.0, 5e-6], ids=["exact height", "noise of 5 um"])
@pytest.mark.parametrize("samples", [8.2, 10.1, 12.3, 25.4])
def test_a_sine_of_few_samples_a_period_has_its_viscosity(samples: float, noise: float) -> None:
    # F = (4/3) E/(1 - nu^2) sqrt(R) d^1.5 + 4 eta sqrt(R)/(1 - nu) d^0.5 d', nu = 0.5 (the paper's law)
    rng = np.random.default_rng(1)
    interval = 0.02
    time = np.arange(400) * interval
    frequency = 1.0 / (samples * interval)
    phase = 2 * np.pi * frequency * time + 0.3
    depth = 3e-3 - 1e-3 * np.cos(phase)
    rate = 1e-3 * 2 * np.pi * frequency * np.sin(phase)
    force = np.sqrt(RADIUS) * (16 / 9 * ELASTICITY * depth**1.5 + 8 * VISCOSITY * depth**0.5 * rate)
    record = palpate.record(
        time=time,
        force=force + rng.normal(0.0, 0.02, len(time)),
        height=-depth + rng.normal(0.0, noise, len(time)) if noise else -depth,
        timing="0.1 ms",
        tip_mass=0,
        tare="0 N",
    )
    fit = palpate.fit(record, tip=Sphere(radius=RADIUS), model="dr")
    for value, truth in ((fit.elasticity, ELASTICITY), (fit.viscosity, VISCOSITY)):
        assert abs(value.value - truth) < 2 * value.combined
        assert value.combined < 0.05 * truth


@pytest.mark.parametrize("segment", ["active", "load", "unload"])
def test_stretches_of_a_record_are_no_noise_of_the_height(segment: str) -> None:
    """A step from the end of one stretch to the next one's begin made a noise of 0.2 mm, and E 3 % too high."""
    rng = np.random.default_rng(1)
    approach = np.arange(-2.8, 0.0, 0.002)
    sine = np.arange(0.0, 4.0, 0.002)
    time = np.concatenate([approach, sine])
    position = np.concatenate([1.8e-3 + 1e-3 * approach, 3e-3 - 1.2e-3 * np.cos(4 * np.pi * sine)])
    depth = np.maximum(position, 0.0)
    damping = 8 * VISCOSITY * np.sqrt(depth) * np.gradient(position, time)
    force = np.sqrt(RADIUS) * (16 / 9 * ELASTICITY * depth**1.5 + damping) + rng.normal(0.0, 0.002, len(time))
    height = -position + rng.normal(0.0, 2e-6, len(time))
    record = palpate.record(time=time - time[0], force=force, height=height, timing="0.1 ms", tip_mass=0)
    fit = palpate.fit(record, tip=Sphere(radius=RADIUS), model="dr", estimator=CasadiFit(segment=segment))
    assert fit.elasticity.value == pytest.approx(ELASTICITY, rel=3e-3)
    assert fit.viscosity.value == pytest.approx(VISCOSITY, rel=0.01)
