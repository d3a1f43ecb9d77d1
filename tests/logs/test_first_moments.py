"""What the first moments of a file say: air of any noise and offset is a tare, a hold is no rest."""

import numpy as np
import pytest
from palpate_kit.logs.suggestion import no_tare
from palpate_logs.csv_roles import suggest_csv


def write(path, time, height, force):
    rows = np.column_stack([time, 1e3 * height, force]).tolist()
    path.write_text("time_s,z_mm,force_N\n" + "".join(f"{t:.3f},{z:.5f},{f:.5f}\n" for t, z, f in rows))
    return path


def press(rate, air, down, hold, peak=0.5, deep=2e-3, noise=2e-3):
    """Time, height and force of air, a way down with its second half in the material, and a hold."""
    time = np.arange(round((air + down + hold) * rate)) / rate
    height = deep - 2 * deep * np.clip((time - air) / down, 0.0, 1.0)
    force = peak * (np.maximum(-height, 0.0) / deep) ** 1.5
    return time, height, force + noise * np.random.default_rng(0).standard_normal(len(time))


@pytest.mark.parametrize("share", [0.005, 0.025, 0.05, 0.1])
@pytest.mark.parametrize("offset", [0.0, 0.3, 12.0])
def test_air_of_any_noise_and_offset_is_a_tare(share, offset):
    """From 2.5 % of the peak on it was "the tip touches in the first 0.9 s"."""
    time, _, force = press(100.0, 1.5, 3.0, 1.0, noise=share * 0.5)
    assert no_tare(time, force + offset) is None


def test_noise_through_a_low_pass_is_no_motion():
    time, _, force = press(500.0, 1.5, 3.0, 1.0, noise=0.0)
    noise = np.random.default_rng(1).standard_normal(len(time))
    assert no_tare(time, force + 0.02 * np.convolve(noise, np.ones(25) / 5.0, "same")) is None


@pytest.mark.parametrize("lasts", [0.25, 0.9, 3.0])
def test_the_air_of_a_curve_that_lasts_less_than_a_second_is_a_tare(lasts):
    """Of a microscope: 0.9 s of it are air and contact."""
    time, _, force = press(1000.0, 0.0, 4.5, 0.0)
    assert no_tare(lasts / 4.5 * time, force) is None
    assert no_tare(lasts / 4.5 * time[:2250], force[2250:]) is not None


def test_a_record_that_begins_in_contact_gives_no_tare():
    time, _, force = press(100.0, 0.0, 1.5, 2.0, noise=5e-3)
    assert no_tare(time[75:], force[75:]) is not None


def test_a_hold_longer_than_the_air_is_no_rest(tmp_path):
    """Sixty seconds of hold after one of air: the sign of the force was -1."""
    found = suggest_csv(write(tmp_path / "hold.csv", *press(20.0, 1.0, 2.0, 60.0)), {})
    assert found.alignment["force"]["sign"] == 1
    assert found.alignment["position"]["sign"] == 1


def test_the_sign_of_a_position_follows_the_plain_correlation(tmp_path):
    """A cylinder under compression that is held at the end: force and position rise together, at one speed."""
    time = np.arange(120) / 10.0
    travel = 2e-3 * np.minimum(time / 9.0, 1.0)
    random = np.random.default_rng(3)
    force = 5.0 * travel / 2e-3 + 0.5 * (travel < 2e-3) * (time > 0.1) + 0.04 * random.standard_normal(len(time))
    found = suggest_csv(write(tmp_path / "cylinder.csv", time, travel, force), {})
    assert found.alignment["force"]["sign"] == 1
    assert found.alignment["position"]["sign"] == -1
