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
    force = np.minimum(np.sin(np.arange(300) / 60.0), 0.7)
    rows = np.ones(300, bool)
    assert force_limit(force) == 0.7
    assert at_limit(force, rows).sum() == np.count_nonzero(force == 0.7) > 10
    assert force_limit(np.sin(np.arange(300) / 60.0)) is None
    assert force_limit(np.round(np.sin(np.arange(300) / 60.0), 1)) is None
    assert force_limit(np.full(5, np.nan)) is None
