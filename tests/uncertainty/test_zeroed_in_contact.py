"""A force that is zeroed at rest in contact and stated as free air, and zeros that are stated."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_uncertainty.force_noise import standstill_count

from tests.uncertainty.presses import ELASTICITY, facts, write_press, zeroed_press

RESTS = (-0.2e-3, -0.4e-3, -0.6e-3, -0.8e-3)  # [m]


def fitted_rows(palpate, folder, **others):
    """Rows of fits.csv of a folder of presses, by name of the file."""
    out = folder.parent / "fits"
    done = palpate("fit", folder, "-o", out, "--no-pictures", *facts(**others))
    assert done.returncode == 0, done.stderr
    with (out / "fits.csv").open(encoding="utf-8") as file:
        return {row["curve"].rpartition("/")[2]: SimpleNamespace(**row) for row in csv.DictReader(file)}


@pytest.mark.parametrize(
    ("rest", "noise", "step"),
    [(0.5, 5e-7, 0.0), (1.0, 5e-6, 0.0), (1.0, 1e-9, 1e-6), (2.0, 2e-9, 0.0), (1.0, 0.0, 1e-6)],
)
def test_a_standstill_ends_where_the_tip_moves_by_more_than_its_height_scatters(rest, noise, step):
    time = np.arange(1600) / 200.0
    place = np.interp(time, [rest, 6.0], [0.3e-3, -2e-3]) + noise * np.random.default_rng(0).standard_normal(len(time))
    place = np.round(place / step) * step if step else place
    length = standstill_count(time, place) / 200.0
    assert rest <= length < rest + 0.08
    assert standstill_count(time[time > rest + 0.1], place[time > rest + 0.1]) == 0


def test_a_tip_that_never_moves_is_at_rest_all_along():
    time = np.arange(1000) / 200.0
    assert standstill_count(time, 1e-6 * np.random.default_rng(0).standard_normal(1000)) == 1000
    assert standstill_count(time, np.zeros(1000)) == 1000
    assert standstill_count(time[:0], time[:0]) == 0
    unknown = np.where(np.arange(1000) < 200, np.nan, 0.0)  # nothing shows that the first readings are at rest
    assert standstill_count(time, unknown) == 0


@pytest.mark.slow
def test_a_force_zeroed_in_contact_is_doubted_and_its_uncertainty_covers_the_truth(palpate, tmp_path):
    folder = tmp_path / "curves"
    folder.mkdir()
    for i, rest in enumerate(RESTS):
        write_press(folder / f"rest{i}.csv", zeroed_press(i, rest))
    write_press(folder / "air.csv", zeroed_press(4, 0.5e-3))
    rows = fitted_rows(palpate, folder)
    for name, row in rows.items():
        apart = abs(float(row.elasticity) - ELASTICITY)
        assert apart <= 2.0 * float(row.elasticity_combined)
        assert row.verdict == ("good" if name == "air.csv" else "doubtful")
    assert float(rows["air.csv"].elasticity_combined) < 0.01 * ELASTICITY
    assert float(rows["rest3.csv"].elasticity) > 1.15 * ELASTICITY


@pytest.mark.slow
def test_a_stated_zero_keeps_its_uncertainty(palpate, tmp_path):
    folder = tmp_path / "curves"
    folder.mkdir()
    write_press(folder / "rest.csv", zeroed_press(2, -0.6e-3))
    row = fitted_rows(palpate, folder, tare="0 N +- 100 mN")["rest.csv"]
    assert float(row.elasticity_combined) > 3e3
    assert abs(float(row.elasticity) - ELASTICITY) < float(row.elasticity_combined)
