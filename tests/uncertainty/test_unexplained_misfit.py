"""A lack of fit that nothing explains has its size, and a clipped force only seems to have one."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_kit.numerics.force_limit import at_limit, force_limit

from tests.uncertainty.presses import ELASTICITY, VISCOSITY, facts, press, sticking_press, write_press


def fitted_row(palpate, tmp_path, columns):
    """The row of fits.csv of a press."""
    folder = tmp_path / "curves"
    folder.mkdir()
    write_press(folder / "press.csv", columns)
    palpate("fit", folder, "-o", "fits", "--no-pictures", *facts())
    with (tmp_path / "fits" / "fits.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    return SimpleNamespace(**row)


@pytest.mark.slow
@pytest.mark.parametrize("work", [1.0, 2.0])
def test_a_lack_of_fit_that_nothing_explains_has_the_size_of_its_discrepancy(palpate, tmp_path, work):
    """Adhesion of 2 J/m^2 is 33 +- 14 kPa for 25: drift in steps explains most of it, and free air adds as much."""
    row = fitted_row(palpate, tmp_path, sticking_press(1, work))
    assert {"lack-of-fit", "model-discrepancy"} & {*row.flags.split()}
    assert float(row.elasticity) > 1.08 * ELASTICITY
    assert abs(float(row.elasticity) - ELASTICITY) < 2.0 * float(row.elasticity_combined)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.6, 0.9])
def test_a_force_that_is_clipped_gives_the_value_of_what_is_below(palpate, tmp_path, share):
    time, force, height = press(4, 0.5e-3)
    row = fitted_row(palpate, tmp_path, (time, np.minimum(force, share * force.max()), height))
    assert row.verdict == row.elasticity_verdict == row.viscosity_verdict == "doubtful"
    assert "saturated" in row.flags
    assert "lack-of-fit" not in row.flags
    assert abs(float(row.elasticity) - ELASTICITY) < 0.004 * ELASTICITY
    assert float(row.elasticity_combined) < 0.006 * ELASTICITY
    assert abs(float(row.viscosity) - VISCOSITY) < 2.0 * float(row.viscosity_combined)


def test_a_force_stands_at_its_limit_where_it_does_so_more_often_than_below():
    height = -np.sin(np.arange(300) / 60.0)
    force = np.minimum(-height, 0.7)
    rows = np.ones(300, bool)
    assert force_limit(force) == 0.7
    assert at_limit(force, height, rows).sum() == np.count_nonzero(force == 0.7) > 10
    assert force_limit(-height) is None
    assert force_limit(np.round(-height, 1)) is None
    assert force_limit(np.full(5, np.nan)) is None


@pytest.mark.parametrize(("digits", "noise"), [(9, 0.0), (2, 0.0), (2, 1e-3)])
def test_a_force_without_noise_that_stands_with_the_tip_is_at_no_limit(digits, noise):
    """A hold; the same readings are a limit where the tip goes deeper meanwhile, or where the rest of them is noisy."""
    depth = np.concatenate([np.linspace(0.0, 1.0, 300), np.ones(200), np.linspace(1.0, 0.5, 100)])
    rows, force = np.ones(600, bool), 0.8 * depth**1.5
    reading = np.round(force + noise * np.random.default_rng(1).standard_normal(600), digits)
    assert force_limit(reading) == 0.8
    assert not at_limit(reading, -depth, rows).any()
    assert at_limit(np.minimum(reading, 0.7), -depth, rows).sum() > 200
    noisy = np.where(depth < 1.0, force + 0.02 * np.random.default_rng(2).standard_normal(600), force)
    assert at_limit(np.minimum(noisy, 0.8), -depth, rows).sum() >= 200
