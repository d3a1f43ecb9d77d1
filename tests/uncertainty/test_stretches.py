"""One value for a whole sweep: held against least squares on every stretch of the way."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_filters import ExtendedKalmanFilter, KinematicFilter
from palpate_uncertainty.identifiability import identifiability


def swept(track, stiffer, lifted=0.0):
    """The same record along 40 mm, its second half over a material that is stiffer, after so long [s] in the air."""
    kept = track.kept
    late = kept.time > kept.time.mean()
    way = np.where(late, 0.04, 0.0) if lifted else np.linspace(0.0, 0.04, len(kept.time))
    force = kept.force * np.where(late, stiffer, 1.0)
    lateral = np.column_stack([way, np.zeros(len(way))])
    return replace(track, kept=replace(kept, force=force, lateral=lateral, time=kept.time + lifted * late))


@pytest.fixture(scope="module")
def point(evidence):
    return evidence("clean", ExtendedKalmanFilter(start_from="fit"), mass=0.14)


def test_one_value_of_a_material_that_changes_is_flagged_and_its_uncertainty_reaches_the_places(point):
    track = swept(replace(point, tip_mass=0.0), 1.3)
    (found,) = identifiability([track]).values()
    assert [flag.code for flag in found.flags] == ["elsewhere"]
    assert "its one value is" in found.flags[0].message
    low, high = found.table["stretches"]["elasticity"]
    assert high / low == pytest.approx(1.3, rel=0.1)
    assert 0.1 < found.terms["elasticity"] / track.values[0] < 0.3


def test_one_value_of_an_even_material_is_not(point):
    (found,) = identifiability([swept(point, 1.0)]).values()
    assert not found.flags
    assert found.table["stretches"]["elasticity"] == pytest.approx(2 * [point.values[0]], rel=0.05)


def test_sites_between_which_the_tip_is_lifted_are_no_sweep(point):
    (found,) = identifiability([swept(point, 1.3, lifted=1.0)]).values()
    assert not found.flags


def test_what_follows_changes_is_not_held_to_one_value(evidence):
    assert identifiability([swept(evidence("clean", KinematicFilter(sweep_speed=4e-3)), 1.3)]) == {}
