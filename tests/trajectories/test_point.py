"""Point palpation."""

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_testing import check_trajectory
from palpate_trajectories.point import Point


@pytest.mark.parametrize("duration", [10.0, 2.3, 0.25])
@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0])
def test_it_keeps_the_promises_of_a_trajectory(frequency, duration):
    check_trajectory(Point(bias=0.004, frequency=frequency, duration=duration))


def test_the_measured_part_is_the_papers_sine():
    press = Point(bias=0.004, amplitude=0.001, frequency=2.0, duration=10.0)
    time = np.arange(0.0, press.total_duration, 0.002)
    setpoint = press.at(time)
    measured = setpoint.measuring
    since = time[measured] - time[measured][0]
    assert since[-1] == pytest.approx(10.0, abs=0.003)
    assert setpoint.position[measured, 2] == pytest.approx(-0.004 - 0.001 * np.sin(4 * np.pi * since), abs=3e-5)


def test_it_never_goes_deeper_than_bias_and_amplitude():
    press = Point(bias=0.004, amplitude=0.001)
    setpoint = press.at(np.arange(0.0, press.total_duration, 1e-3))
    assert setpoint.position[:, 2].min() >= -0.005 - 1e-9
    assert setpoint.position[[0, -1], 2] == pytest.approx(press.clearance, abs=1e-6)


@pytest.mark.parametrize("wrong", [{"amplitude": 0.004}, {"frequency": 0.0}, {"bias": -0.001}, {"speed": 0.0}])
def test_what_cannot_be_done_is_refused(wrong):
    with pytest.raises(ConfigurationError):
        Point(**{"bias": 0.004, **wrong})
