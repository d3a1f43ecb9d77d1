"""Noise of the height in stiff records: what it takes from E in a fit, and what it must not be called."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import Problem, Samples
from palpate_filters import KinematicFilter
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere

_spec = importlib.util.spec_from_file_location("coverage_bench", Path(__file__).parents[2] / "benchmarks/coverage.py")
bench = importlib.util.module_from_spec(_spec)
sys.modules["coverage_bench"] = bench  # where its dataclasses look for themselves
_spec.loader.exec_module(bench)


def stiff(seed, **changed):
    """A shallow palpation of 1 MPa with a large sphere, everything as declared: 5 um of height are 0.09 N."""
    draw = {"elasticity": 1e6, "viscosity": 2.7e3, "radius": 15e-3, "nu": bench.NOMINAL_NU, "mass": 0.14, "late": 0.0}
    draw |= {"depth": 0.6e-3, "amplitude": 0.15e-3, "frequency": 1.0, "phase": float(seed)} | changed
    return bench.Draw(5000 + seed, "sphere", **draw)


@pytest.mark.slow
def test_noise_of_the_height_takes_nothing_from_the_stiffness():
    """Left alone it takes 2 standard deviations of E: the mean of 8 errors over theirs is within 2.6/sqrt(8)."""
    errors = []
    for seed in range(8):
        draw = stiff(seed)
        samples, _ = bench.record(draw)
        found = CasadiFit().start(Problem(bench.model_of(draw, draw.radius), 0.14, 1e-4, 1.0)).run(samples)
        row = np.flatnonzero(np.isfinite(found.values[:, 0]))[-1]
        errors.append((found.values[row, 0] - draw.elasticity) / found.std[row, 0])
        assert not {"misfit", "not-converged"} & {flag.code for flag in found.flags}
    assert abs(np.mean(errors)) < 2.6 / np.sqrt(8)


@pytest.mark.parametrize("estimator", [CasadiFit(), KinematicFilter()])
@pytest.mark.parametrize(("frequency", "elasticity"), [(0.6, 1.4e6), (2.0, 8e5)])
def test_noise_of_the_motion_is_no_lack_of_fit(estimator, frequency, elasticity):
    """The noise of height and velocity, felt through a stiff contact, is not what the sensor had at standstill."""
    draw = stiff(3, frequency=frequency, elasticity=elasticity, viscosity=elasticity / 3 * 8e-3, radius=5e-3)
    samples, report = bench.record(draw)
    model = bench.model_of(draw, draw.radius)
    (found,) = bench.results(
        bench.load(), model, 0.14, samples, report, {"track": estimator}, {"poisson": bench.NU}
    ).values()
    assert "lack-of-fit" not in [flag.code for flag in found.flags]


@pytest.mark.parametrize("scale", [1e-2, 1e-4])
def test_a_fit_does_not_depend_on_the_scale_of_lengths(scale):
    """The same press with every length a hundredth, or a ten-thousandth, and forces as they were: E by its unit.

    A step of 1 um for the derivatives of the correction for noise of the height would reach across all of the press.
    """
    found = []
    for factor in (1.0, scale):
        height = factor * np.concatenate([np.linspace(1e-3, -2e-3, 1500), np.linspace(-2e-3, 1e-3, 1500)])
        random = np.random.default_rng(7)
        force = 16 / 9 * 1e5 * np.sqrt(5e-3) * np.maximum(-height / factor, 0.0) ** 1.5
        force += 1e-3 * random.standard_normal(len(force))
        height += factor * 2e-5 * random.standard_normal(len(force))
        model = DimensionalityReduction(indenter=Sphere(radius=factor * 5e-3))
        samples = samples_of(height, force)
        tracker = CasadiFit(fixed={"viscosity": 0.0}).start(Problem(model, 0.0, None))
        values = tracker.run(samples).values[:, 0]
        found.append(float(values[np.isfinite(values)][-1]) * factor**2)
    assert found[1] == pytest.approx(found[0], rel=1e-5)
    assert found[0] == pytest.approx(1e5, rel=1e-2)


def samples_of(height, force):
    """Samples at 500 Hz, in contact below 0."""
    time = np.arange(len(height)) / 500.0
    contact = height < 0
    velocity = np.gradient(height, time)
    stamp = np.arange(len(height), dtype=np.int64) * 2_000_000
    return Samples(stamp, time, np.full(len(time), 0.002), force, height, velocity, contact, contact)
