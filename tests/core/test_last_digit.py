"""The last digit of a channel: its step, whether it exceeds the noise, and readings that are one by it."""

import numpy as np
import pytest
from palpate import LastDigit

STEP = 0.01
SLOW = 0.4 * np.sin(np.linspace(0.0, 3.0, 800))  # a tenth of a step from reading to reading


def readings(noise, step=STEP, signal=SLOW, seed=1):
    """A signal with noise [steps], rounded."""
    values = signal + noise * step * np.random.default_rng(seed).standard_normal(len(signal))
    return np.round(values / step) * step if step else values


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5, 2.0])
def test_the_step_of_rounded_readings_is_their_last_digit(noise):
    digit = LastDigit.of(np.append(readings(noise), np.nan))
    assert digit.step == pytest.approx(STEP)
    assert digit.noise == pytest.approx(STEP / np.sqrt(12.0))


@pytest.mark.parametrize(("noise", "exceeds"), [(0.0, True), (0.1, True), (0.3, True), (0.7, False), (2.0, False)])
@pytest.mark.parametrize("seed", range(5))
def test_a_last_digit_exceeds_noise_below_half_of_it(noise, exceeds, seed):
    values = readings(noise, seed=seed)
    assert LastDigit.of(values).exceeds_noise(values) is exceeds


def test_readings_without_noise_are_known_by_their_smooth_course_where_no_digit_shows():
    assert LastDigit.of(SLOW).exceeds_noise(SLOW)
    noisy = SLOW + 1e-4 * np.random.default_rng(2).standard_normal(len(SLOW))
    assert not LastDigit.of(noisy).exceeds_noise(noisy)


def test_readings_that_never_change_have_no_step():
    assert LastDigit.of(np.full(9, 0.3)).step == LastDigit.of(np.zeros(0)).step == 0.0
    assert not LastDigit.of(np.zeros(3)).exceeds_noise(np.zeros(3))


def test_neighbours_within_one_step_are_one_plateau():
    values = STEP * np.array([0, 0, 0, 1, 0, 0, 2, 2, 5, 9, 9, 9])
    assert LastDigit(STEP).plateau_sizes(values).tolist() == [6, 6, 6, 6, 6, 6, 2, 2, 1, 3, 3, 3]
    assert LastDigit(STEP).plateau_sizes(np.zeros(0)).tolist() == []
