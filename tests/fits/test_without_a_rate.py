"""A file without a time: E of an elastic press does not depend on the rate; what has a second in its unit needs it."""

import csv

import numpy as np
import pytest

E, R = 50e3, 3e-3  # [Pa], [m] of a paraboloid


def fitted(palpate, tmp_path, *options):
    """The row of a press without a time, and what the command said."""
    depth = np.interp(np.arange(600.0), [0, 100, 400, 500, 599], [-0.5, -0.5, 2.0, 2.0, -0.5])
    force = 16 / 9 * E * np.sqrt(R) * (1e-3 * np.maximum(depth, 0.0)) ** 1.5
    force += 1e-3 * np.random.default_rng(4).standard_normal(len(depth))
    rows = np.column_stack([force, depth])
    np.savetxt(tmp_path / "press.csv", rows, "%.6f", ",", header="Load [N],Indentation [mm]", comments="")
    done = palpate("fit", "press.csv", "--tip", "paraboloid 3 mm", "--out", "fits", "--no-pictures", *options)
    with (tmp_path / "fits" / "fits.csv").open(encoding="utf-8") as file:
        return next(csv.DictReader(file)), done


def test_a_press_without_a_time_has_an_elasticity_and_a_viscosity_that_needs_the_rate(palpate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    row, done = fitted(palpate, tmp_path)
    assert done.returncode == 0
    assert abs(float(row["elasticity"]) - E) < 2.0 * float(row["elasticity_combined"])
    assert (row["elasticity_verdict"], row["viscosity_verdict"]) == ("good", "needs rate")
    assert "100 rows in a second" in done.stdout
    assert "--rate VALUE" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("rate", ["20 Hz", "1000 Hz"])
def test_the_elasticity_of_an_elastic_press_is_the_same_at_any_rate(palpate, tmp_path, monkeypatch, rate):
    monkeypatch.chdir(tmp_path)
    row, _ = fitted(palpate, tmp_path, "--rate", rate, "--tip-mass", "0 g")
    assert float(row["elasticity"]) == pytest.approx(E, rel=3e-3)
    assert (row["elasticity_verdict"], row["viscosity_verdict"]) == ("good", "not determined")


def test_a_short_table_without_a_time_is_one_of_results_and_asks(tmp_path, palpate):
    """A sheet of results next to records is left out, as it was."""
    rows = np.column_stack([np.linspace(1.0, 2.0, 30), np.linspace(0.1, 0.9, 30)])
    np.savetxt(tmp_path / "results.csv", rows, "%.4f", ",", header="Fmax [N],dL [mm]", comments="")
    done = palpate("fit", str(tmp_path / "results.csv"), "--tip", "paraboloid 3 mm", "--out", str(tmp_path / "fits"))
    assert done.returncode
    assert "say it with --rate" in done.stderr
