"""The share of the force across the tool."""

import numpy as np
import pytest
from palpate import Batch
from palpate_engine.alignment.lateral_force import LateralForce


def readings(count=4000, share=(0.1, -0.05), noise=0.05):
    random = np.random.default_rng(0)
    along = 5.0 + 4.0 * np.sin(np.arange(count) / 40.0)
    across = np.outer(along, share) + np.array([1.3, -0.4])  # N of weight and bias, which do not change
    values = np.column_stack([across, along]) + noise * random.standard_normal((count, 3))
    values[7] = np.nan
    values[8, 2] = np.inf
    return np.column_stack([values, np.full((count, 3), np.nan)])  # torques are not asked for


def share_of(values, pieces=1, columns=(2, 0, 1)):
    found = LateralForce(columns)
    for part in np.array_split(values, pieces):
        stamps = np.arange(len(part))
        found.feed(Batch("wrench", stamps, stamps, part))
    return found.share


def test_it_is_what_changes_with_the_force_along_the_tool():
    found = share_of(readings())
    assert found.x == pytest.approx(0.1, abs=4 * found.std)
    assert found.y == pytest.approx(-0.05, abs=4 * found.std)
    # 0.05 N of noise over 4000 readings whose force has a standard deviation of 2.8 N
    assert found.std == pytest.approx(0.05 / 2.83 / np.sqrt(4000), rel=0.1)


def test_it_does_not_depend_on_how_a_record_is_cut():
    values = readings()
    assert share_of(values) == share_of(values, pieces=37) == share_of(values, pieces=4000)


@pytest.mark.parametrize("values", [readings(50), np.full((500, 6), 1.25)])
def test_hardly_any_readings_or_a_force_that_does_not_change_have_none(values):
    assert share_of(values) is None
