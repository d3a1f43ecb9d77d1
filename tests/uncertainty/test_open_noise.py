"""Records without air, and with few readings: what is not tested is said, and what is tested is told."""

import json

import numpy as np
import pytest

DEPTH = 16 / 9 * np.sqrt(5e-3)  # [m^0.5] force of a sphere of 5 mm over modulus and depth^1.5 (Hertz, nu 0.5)


@pytest.fixture
def fitted(palpate, tmp_path, monkeypatch):
    """The result of one file, by its columns."""
    monkeypatch.chdir(tmp_path)

    def fit(time, height, force):
        columns = np.column_stack([time, 1e3 * height, force])
        np.savetxt(
            "curve.csv", columns, delimiter=",", header="time (s),height (mm),force (N)", comments="", fmt="%.6g"
        )
        done = palpate("fit", "curve.csv", "--tip", "paraboloid 5 mm", "--out", "out")
        done = palpate("fit", "curve.csv", "--pipeline", "out/pipeline.toml", "--json", "--out", "one")
        assert done.stdout, done.stderr
        return next(iter(json.loads(done.stdout)["logs"]["curve"]["tracks"].values()))

    return fit


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_force_that_was_zeroed_in_contact_is_found_with_its_zero(fitted, seed):
    """500 kPa, zeroed 1.5 mm deep: without the zero the press looks like one of 750 kPa."""
    random = np.random.default_rng(seed)
    time = np.arange(218) / 125
    depth = np.minimum(2e-3 * time, 1.5e-3)
    force = DEPTH * 5e5 * ((depth + 1.5e-3) ** 1.5 - 1.5e-3**1.5) + 0.034 * random.standard_normal(218)
    found = fitted(time, -depth, force)
    elasticity = found["parameters"]["elasticity"]
    assert elasticity["verdict"] == "good"
    assert abs(elasticity["value"] - 500e3) < 2 * elasticity["combined"]
    assert "found with the surface" in json.dumps(found["conditions"])


@pytest.mark.slow
def test_the_same_with_its_zero_is_good(fitted):
    random = np.random.default_rng(4)
    time = np.arange(218) / 125
    depth = np.minimum(2e-3 * time, 1.5e-3)
    force = DEPTH * 5e5 * depth**1.5 + 0.034 * random.standard_normal(218)
    found = fitted(time, -depth, force)
    assert found["verdict"] == "good"


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_a_table_of_ten_rows_a_second_is_tested(fitted, exponent):
    """Its readings are no gaps of each other."""
    random = np.random.default_rng(5)
    time = np.arange(1200) / 10
    depth = np.clip(0.05e-3 * (time - 20), 0, 3e-3)
    force = DEPTH * 5e4 * 3e-3**1.5 * (depth / 3e-3) ** exponent + 5e-3 * random.standard_normal(1200)
    found = fitted(time, np.where(depth > 0, -depth, 0.05e-3 * (20 - time)), force)
    assert "gaps" not in json.dumps(found["flags"])
    assert (found["verdict"] == "good") == (exponent == 1.5)
