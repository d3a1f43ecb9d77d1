"""Fits of materials that relax: no local minimum, and E, eta, E_0 of a damper with a Maxwell arm."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import Problem, Samples, force_over_time
from palpate_fits import CasadiFit
from palpate_kit.numerics.tip_travel import longest_window
from palpate_models import (
    DimensionalityReduction,
    DimensionalityReductionMaxwell,
    FractionalKelvinVoigt,
    Poroelastic,
    Sphere,
    StandardLinearSolid,
)
from scipy.signal import lfilter

from tests.simulated import press_and_sines, samples

ROOT = Path(__file__).parents[2]
RADIUS, E, NOISE = 5e-3, 112.5e3, 0.05
FINE = 10  # steps of the hereditary integral in one sample


def record(viscosity=0.0, branch=0.0, time_constant=0.3, seed=0, duration=5.0, rate=400.0):
    """A press at 4 mm/s and a sine of 1 mm at 2 Hz, by the hereditary integral of d^1.5, summed step by step."""
    random = np.random.default_rng(seed)
    n = round(duration * rate)
    time = np.arange(n * FINE) / (rate * FINE)
    depth = np.where(time < 1.25, -1e-3 + 4e-3 * time, 4e-3 + 1e-3 * np.sin(4 * np.pi * (time - 1.25)))
    speed = np.gradient(depth, time)
    inside = np.maximum(depth, 0.0)
    kept = np.exp(-(time[1] - time[0]) / time_constant)
    fading = lfilter([1.0], [1.0, -kept], np.diff(inside**1.5, prepend=0.0) * np.sqrt(kept))
    force = 16 / 9 * np.sqrt(RADIUS) * (E * inside**1.5 + branch * fading)
    force += 8 * viscosity * np.sqrt(RADIUS * inside) * np.where(depth > 0, speed, 0.0)
    force, depth, speed, time = force[::FINE], depth[::FINE], speed[::FINE], time[::FINE]
    height = -depth + 5e-6 * random.standard_normal(n)
    velocity = -speed + 0.67e-3 * random.standard_normal(n)
    stamp = np.arange(n, dtype=np.int64) * round(1e9 / rate)
    reading = force + NOISE * random.standard_normal(n)
    return Samples(stamp, time, np.diff(time, prepend=0.0), reading, height, velocity, depth > 0, depth > 0)


def fit(model, samples):
    return CasadiFit(profile=False).start(Problem(model, None)).run(samples)


def test_a_solid_that_only_damps_leaves_no_more_than_its_noise():
    """Kelvin-Voigt data are the limit of a short relaxation time; a minimum beside it leaves twice the noise."""
    found = fit(StandardLinearSolid(indenter=Sphere(radius=RADIUS)), record(viscosity=362.0))
    assert found.details["rms"] == pytest.approx(NOISE, rel=0.03)
    assert found.values[-1][0] == pytest.approx(E, rel=0.01)
    assert str(found.flags[0]).startswith("at-bound: relaxation_time")


@pytest.mark.slow
@pytest.mark.parametrize(("branch", "time_constant"), [(11e3, 0.3), (20e3, 0.5)])
def test_elasticity_and_viscosity_of_a_relaxing_record(branch, time_constant):
    model = DimensionalityReductionMaxwell(indenter=Sphere(radius=RADIUS))
    values, scores = [], []
    for seed in range(2):
        found = fit(model, record(362.0, branch, time_constant, seed))
        values.append(found.values[-1])
        scores.append((found.values[-1] - [E, 362.0, branch, time_constant]) / found.std[-1])
        assert found.flags == ()
    mean = np.mean(values, axis=0)
    assert mean[0] == pytest.approx(E, rel=0.01)
    assert mean[1] == pytest.approx(362.0, rel=0.03)  # 1 % in 10 s; these are short
    assert np.abs(np.mean(scores, axis=0)).max() < 2.5


def test_the_instant_elasticity_stands_beside_the_lasting_one():
    model = DimensionalityReductionMaxwell(indenter=Sphere(radius=RADIUS))
    told = {value.name: (value.value, value.unit) for value in model.material([E, 362.0, 20e3, 0.3])}
    assert told == {
        "elasticity": (E, "Pa"),
        "viscosity": (362.0, "Pa*s"),
        "instant_elasticity": (E + 20e3, "Pa"),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "theta"),
    [(Poroelastic, (100e3, 0.2, 5e-6)), (FractionalKelvinVoigt, (60e3, 40e3, 0.4))],
)
def test_a_model_whose_numbers_are_all_nonlinear_is_found_from_its_own_guess(model, theta):
    """No start is told: the search begins where the model says, not at 1 Pa and half a metre away."""
    solid = model(indenter=Sphere(radius=RADIUS))
    time, depth = press_and_sines()
    force = force_over_time(solid, time, depth, np.gradient(depth, time), theta, pulls=False)
    found = CasadiFit(profile=False, segment="contact").start(Problem(solid, 0.0)).run(samples(time, depth, force, 0))
    row = np.flatnonzero(np.isfinite(found.values).all(axis=1))[0]
    assert (np.abs(found.values[row] - theta) < 3.5 * found.std[row]).all()
    assert (found.std[row] < 0.1 * np.array(theta)).all()
    assert not found.flags


def test_the_motion_is_not_smoothed_beyond_a_models_fastest_state():
    """Ten times 2 ms of a springpot; a solid of a tenth of a second, and one without states, as noise has it."""
    tip = Sphere(radius=RADIUS)
    assert longest_window(FractionalKelvinVoigt(indenter=tip)) == pytest.approx(0.02)
    assert (
        longest_window(StandardLinearSolid(indenter=tip)) > 0.2 == longest_window(DimensionalityReduction(indenter=tip))
    )


def bench():
    """The benchmark of coverage, whose forces are made without the product."""
    spec = importlib.util.spec_from_file_location("coverage_memory", ROOT / "benchmarks" / "coverage_memory.py")
    found = importlib.util.module_from_spec(spec)
    sys.modules["coverage_memory"] = found  # where its dataclasses look for themselves
    spec.loader.exec_module(found)
    return found


def test_without_noise_nothing_is_biased_by_how_the_motion_is_read():
    """Lee and Radok's integral over twenty steps a sample; a rate that does not add up to the depth made 0.16 %."""
    model, theta = StandardLinearSolid(indenter=Sphere(radius=RADIUS)), (100e3, 40e3, 0.2)
    force = bench().force_of(bench().MATERIALS["standard-linear-solid"])
    time = 4e-3 * np.arange(len(force))
    record_ = samples(time, bench().depth_of(time), force, None)
    found = CasadiFit(profile=False, segment="contact").start(Problem(model, 0.0)).fit(record_)
    np.testing.assert_allclose(found.solution.x[:3], theta, rtol=3e-4)


def test_noise_of_the_height_is_corrected_where_a_material_remembers():
    """20 um of it take 0.5 % from E and 0.2 % from E_1, if nothing is done: of E four standard deviations."""
    model, theta = StandardLinearSolid(indenter=Sphere(radius=RADIUS)), np.array([100e3, 40e3])
    force = bench().force_of(bench().MATERIALS["standard-linear-solid"])
    time = 4e-3 * np.arange(len(force))
    fit = CasadiFit(profile=False, segment="contact", fixed={"relaxation_time": 0.2}).start(Problem(model, 0.0))
    solutions = [
        fit.fit(samples(time, bench().depth_of(time), force, seed, force_std=0.01, position_std=20e-6)).solution
        for seed in range(4)
    ]
    scatter = np.std([one.x[:2] for one in solutions], axis=0, ddof=1) / 2
    assert (np.abs(np.mean([one.x[:2] for one in solutions], axis=0) - theta) < 4 * scatter + 1e-3 * theta).all()
    assert np.abs(np.mean([one.moved[:2] for one in solutions], axis=0) / theta).max() > 2e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["burgers", "maxwell", "power-law", "generalised-maxwell-2", "dimensionality-reduction-maxwell"]
)
def test_at_little_noise_the_error_is_no_more_than_its_std_says(name):
    """0.01 N and 5 um: Burgers' E was 4.8 standard deviations off, Maxwell's 2.6."""
    made = bench()
    force = made.force_of(made.MATERIALS[name])
    found = [made.rows_of(name, force, 0.01, draw) for draw in range(10)]
    scores = np.array([[(row["value"] - row["truth"]) / row["std"] for row in rows] for rows in found])
    assert np.abs(scores.mean(axis=0)).max() < 3.5 / np.sqrt(10)
