"""Noise of the height in stiff records: what it takes from E in a fit, and what it must not be called."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import Problem
from palpate_filters import KinematicFilter
from palpate_fits import CasadiFit

_spec = importlib.util.spec_from_file_location("coverage_bench", Path(__file__).parents[2] / "benchmarks/coverage.py")
bench = importlib.util.module_from_spec(_spec)
sys.modules["coverage_bench"] = bench  # where its dataclasses look for themselves
_spec.loader.exec_module(bench)


def stiff(seed, **changed):
    """A shallow palpation of 1 MPa with a large sphere, everything as declared: 5 um of height are 0.09 N."""
    draw = {"elasticity": 1e6, "viscosity": 2.7e3, "radius": 15e-3, "nu": bench.NOMINAL_NU, "mass": 0.14, "late": 0.0}
    draw |= {"depth": 0.6e-3, "amplitude": 0.15e-3, "frequency": 1.0, "phase": float(seed)} | changed
    return bench.Draw(5000 + seed, "sphere", **draw)


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
