"""``check_estimator(..., standard_set=True)``: short records of the scenes of ``palpate bench``, one pass."""

import numpy as np
import pytest
from palpate import Belief, Estimator, track_by_step
from palpate_filters.ekf import ExtendedKalmanFilter as Ekf
from palpate_testing import check_estimator
from palpate_testing.part_measures import standard_model
from palpate_testing.standard_set_checks import check_standard_set, standard_rows

pytestmark = pytest.mark.slow


class Stuck(Estimator):
    """Says 30 kPa, whatever it sees."""

    def start(self, problem):
        theta = np.array([3e4, 300.0])
        return track_by_step(2, lambda moment: Belief(theta, theta, -moment.position + 3e-4, 1e-4, 1.0))


class Breaking(Estimator):
    """Raises on a sweep, whose samples are many."""

    def start(self, problem):
        count = 0

        def step(moment):
            nonlocal count
            count += 1
            if count > 1400:
                raise ZeroDivisionError("too long")
            theta = np.array([1.125e5, 362.0])
            return Belief(theta, theta, 3e-4 - moment.position, 1e-4, 1.0)

        return track_by_step(2, step)


def test_a_shipped_filter_passes_and_each_scene_has_two_records():
    check_estimator(Ekf(), standard_model(), (1e5, 300.0), standard_set=True)
    rows = list(standard_rows(Ekf()))
    assert len(rows) == 18
    assert all(row["samples"] <= 3.1 * 500 for row in rows)


def test_wrong_values_are_named_by_the_force_that_they_predict():
    with pytest.raises(AssertionError, match=r"Stuck, scene sine .* off by \d+% of the force"):
        check_standard_set(Stuck())


def test_an_estimator_that_raises_is_named_with_its_scene():
    with pytest.raises(AssertionError, match=r"Breaking, scene \w+ .*ZeroDivisionError: too long"):
        check_standard_set(Breaking())
