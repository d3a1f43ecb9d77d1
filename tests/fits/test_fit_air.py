"""The free air before a slow ramp, whose contact a threshold sees 0.7 mm too late."""

import numpy as np
import palpate
import pytest
from palpate import Problem, Samples
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere

RADIUS, E, ETA, NOISE, SPEED = 5e-3, 112.5e3, 362.0, 0.05, 50e-3 / 60
MODEL = DimensionalityReduction(indenter=Sphere(radius=RADIUS))


def press(seed, air=0.5e-3, deep=2.2e-3, rate=500.0):
    """A slow press by Hertz's law and the paper's damper, contact marked where three samples pass 5 sigma."""
    random = np.random.default_rng(seed)
    n = round((air + deep) / SPEED * rate)
    stamp = np.arange(n, dtype=np.int64) * round(1e9 / rate)
    time = stamp / 1e9
    height = air - SPEED * time
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * E * np.sqrt(RADIUS) * depth**1.5 + 8 * ETA * np.sqrt(RADIUS * depth) * SPEED
    force = force + NOISE * random.standard_normal(n)
    above = force > 5 * NOISE
    first = int(np.argmax(above & np.roll(above, 1) & np.roll(above, 2)))
    contact = np.arange(n) >= first
    measured = height + 5e-6 * random.standard_normal(n)
    return Samples(stamp, time, np.diff(time, prepend=0.0), force, measured, np.full(n, -SPEED), contact, contact)


@pytest.mark.slow
def test_the_tare_of_a_slow_ramp_is_that_of_the_air():
    """More than half of what is before the threshold is contact; the air is 0.6 s of 500 Hz."""
    surfaces, stds = [], []
    for seed in range(10):
        fit = CasadiFit(segment="load", unknowns=(), fixed={"viscosity": ETA}, profile=False)
        found = fit.start(Problem(MODEL, None)).run(press(seed))
        (row,) = [row for row in found.report.budget if row.source == "tare"]
        assert row.std == pytest.approx(NOISE / np.sqrt(300), rel=0.6)
        surfaces.append(found.surface[-1])
        stds.append(found.surface_std[-1])
    assert np.std(surfaces) < 20e-6
    assert np.mean(stds) < 2.0 * np.hypot(np.std(surfaces), 3e-6)


def test_other_contact_points_know_the_noise_of_the_air():
    found = CasadiFit(segment="load", unknowns=()).start(Problem(MODEL, None)).run(press(0))
    points = found.details["contact_points"]
    assert abs(points["deviation-from-baseline"]["surface"]) < 0.25e-3
    assert not any(flag.code == "misfit" for flag in found.flags)


@pytest.mark.parametrize("noise", [0.02, 0.002])
@pytest.mark.parametrize("seed", range(1, 5))
def test_a_sine_that_begins_in_contact_has_no_air(seed, noise):
    """1.8 to 4.2 mm deep: a quarter of a period is no air with a touch at its end; E would be 159 for 112."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 4.0, 0.002)
    depth = 3e-3 - 1.2e-3 * np.cos(4 * np.pi * time)
    rate = 1.2e-3 * 4 * np.pi * np.sin(4 * np.pi * time)
    force = np.sqrt(5e-3) * (16 / 9 * 112.5e3 * depth**1.5 + 8 * 362 * np.sqrt(depth) * rate)
    record = palpate.record(
        time=time,
        force=force + rng.normal(0.0, noise, len(time)),
        height=-depth + rng.normal(0.0, 2e-6, len(time)),
        timing="0.1 ms",
        tip_mass=0,
    )
    with pytest.raises(palpate.UserError, match="not at rest in free air"):
        palpate.fit(record, tip=Sphere(radius="5 mm"), model="dr")
