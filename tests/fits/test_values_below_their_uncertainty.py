"""Values that a record does not determine: shown with their uncertainty, and without bias in a mean."""

import csv

import numpy as np
import palpate as python
import pytest
from palpate_models import DimensionalityReduction, Sphere

RADIUS, MODULUS = 5e-3, 50e3  # m, Pa
STATED = ("--tip", "paraboloid 5 mm", "--delay", "0 ms +- 0.2 ms", "--tip-mass", "0 g", "--thickness", "half-space")


def press(seed, viscosity):
    """Time [s], depth [m] and force [N] of a press, held and taken back; noise 5 mN."""
    time = np.arange(1000) / 250.0
    depth = np.interp(time, [0.0, 0.5, 2.0, 3.0, 4.0], [-1e-3, -0.2e-3, 1.6e-3, 1.6e-3, -1e-3])
    contact = np.maximum(depth, 0.0)
    force = 16 / 9 * MODULUS * np.sqrt(RADIUS) * contact**1.5
    force += 8 * viscosity * np.sqrt(RADIUS * contact) * np.gradient(depth, time)
    noise = 5e-3 * np.random.default_rng(seed).standard_normal(len(time))
    return time, depth, np.maximum(force, 0.0) + noise


def fitted_viscosity(seed, viscosity):
    time, depth, force = press(seed, viscosity)
    record = python.record(
        time=time, force=force, height=-depth, delay={"height": "0 ms", "force": "0 ms"}, timing="0.2 ms",
        tip_mass="0 g", tare="free-air",
    )  # fmt: skip
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS), thickness="half-space")
    return python.fit(record, model=model).viscosity


@pytest.mark.slow
@pytest.mark.parametrize("viscosity", [0.0, 5.0])
def test_the_mean_of_many_records_below_their_uncertainty_is_unbiased(viscosity):
    """Of 60 records each viscosity is below twice its uncertainty; a bound at none would make the mean of 0 be 3.5."""
    found = [fitted_viscosity(seed, viscosity) for seed in range(60)]
    values, u = np.array(found), np.array([one.combined for one in found])
    assert np.median(u) > 0.5 * viscosity
    assert values.min() < 0.0
    assert abs(values.mean() - viscosity) < 3.0 * values.std() / np.sqrt(len(values))
    assert np.mean(np.abs(values - viscosity) < 2.0 * u) > 0.88


def test_a_value_that_is_not_determined_is_shown_with_its_uncertainty(palpate, tmp_path):
    time, depth, force = press(1, 5.0)
    table = np.column_stack([time, force, -1e3 * depth])
    head = "time (s),force (N),height (mm)"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=head, comments="")
    done = palpate("fit", tmp_path / "a.csv", *STATED, "--tare", "free-air", "--no-pictures", "-o", tmp_path / "out")
    with (tmp_path / "out" / "fits.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["viscosity_verdict"] == "not determined"
    assert abs(float(row["viscosity"])) < 2.0 * float(row["viscosity_combined"])
    shown = f"{float(row['viscosity']):.1f} ± {float(row['viscosity_combined']):.1f} Pa s not determined"
    assert shown in " ".join(done.stdout.split())
    assert row["verdict"] == row["elasticity_verdict"] == "good"
