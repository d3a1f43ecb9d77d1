"""The motion that a track measured: frequency or speed, depths, and how thick a half-space has to be."""

import numpy as np
import pytest
from palpate_uncertainty.measured_motion import approach_speed, turns


def test_the_turns_of_an_oscillation_are_its_depths():
    time = np.arange(0.0, 5.0, 2e-3)
    depth = 3e-3 + 1e-3 * np.sin(2 * np.pi * 2 * time)
    depth[:50] = 0.0  # a way in does not count
    assert turns(time, depth, 2.0) == pytest.approx([2e-3, 4e-3], rel=1e-3)


@pytest.mark.parametrize("depth", [[0.0, 2e-3], [2e-3, 2e-3, 0.0]])
def test_without_a_way_in_there_is_no_speed(depth):
    time = np.arange(len(depth), dtype=float)
    assert approach_speed(time, np.array(depth)) is None


def test_the_speed_is_that_of_the_way_in_and_not_of_the_hold():
    time = np.arange(0.0, 6.0, 1e-2)
    depth = np.interp(time, [0.0, 2.0, 5.0, 5.5], [-0.5e-3, 1.5e-3, 1.5e-3, -0.5e-3])
    assert approach_speed(time, depth) == pytest.approx(1e-3, rel=1e-2)
