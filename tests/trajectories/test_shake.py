"""The shake in free air."""

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_testing import check_trajectory
from palpate_trajectories.shake import Shake


@pytest.mark.parametrize("frequencies", [(5.0,), (2.0, 5.0), (1.0, 3.0, 7.0)])
@pytest.mark.parametrize("duration", [2.0, 10.0])
def test_it_keeps_the_promises_of_a_trajectory(frequencies, duration):
    check_trajectory(Shake(frequencies=frequencies, amplitude=0.001, duration=duration))


def test_the_measured_part_is_a_sine_of_full_amplitude():
    shake = Shake(amplitude=0.003, duration=4.0)
    time = np.arange(0.0, shake.total_duration, 0.002)
    setpoint = shake.at(time)
    measured = setpoint.measuring
    assert np.count_nonzero(measured) * 0.002 == pytest.approx(4.0, abs=0.005)
    expected = 0.05 + 0.003 * np.sin(2 * np.pi * 5.0 * (time[measured] - shake.standstill))
    assert setpoint.position[measured, 2] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"height": 0.002}, {"frequencies": ()}, {"frequencies": (0.0,)}, {"amplitude": 0.0}, {"duration": 0.0}]
)
def test_what_cannot_be_done_is_refused(wrong):
    with pytest.raises(ConfigurationError):
        Shake(**wrong)
