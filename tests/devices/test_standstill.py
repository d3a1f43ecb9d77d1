"""Before a live motion: the standstill, the way to the start, what is refused, and that filters use the noise."""

import json

import pytest
from palpate.errors import ConfigurationError, DeviceError
from palpate_commands.rig_examination import examine

from tests.devices.simulated_bench import SHORT

NOISY = "twin.bench.force_std=0.2 N"  # four times what the filter is told


@pytest.mark.slow
def test_noise_that_the_filter_was_not_told(simulated, tmp_path):
    """Refused before anything moves; measured and used where the filter asks for it, and the same in a replay."""
    twin = simulated(*SHORT, NOISY, "safety.standstill=0.6 s")  # 480 readings
    before = twin.state()["height"]
    with pytest.raises(DeviceError, match=r"times what the filter declares .*set noise = \"measure\"") as caught:
        twin.run(out="refused")
    assert "[estimator.ekf] force_std = 0.05 N" in str(caught.value)
    assert twin.state()["height"] == pytest.approx(before, abs=1e-6)
    assert (tmp_path / "refused" / "log.mcap").exists()
    measured = ("estimator.ekf.noise=measure", "estimator.kinematic.noise=measure")
    result = twin.run(*measured)
    again = twin.replay(tmp_path / "out" / "log.mcap", "again", *measured)
    ours, theirs = (json.loads((folder / "result.json").read_text()) for folder in (result.folder, again.folder))
    noise, found = ours["tracks"]["dr/ekf"]["details"]["noise"], ours["run"]["live"]["standstill"]
    assert noise["from"] == "standstill"
    assert found["force_std"] == pytest.approx(0.2, rel=0.15)
    # Samples at 500 Hz lie between readings at 800 Hz: two thirds of the variance on average.
    assert noise["force"] == pytest.approx((2 / 3) ** 0.5 * 0.2, rel=0.25)
    assert noise["velocity"] == pytest.approx(0.67e-3, rel=0.25)
    assert theirs["tracks"]["dr/ekf"]["details"] == ours["tracks"]["dr/ekf"]["details"]
    assert (result.folder / "estimates.csv").read_bytes() == (again.folder / "estimates.csv").read_bytes()


@pytest.mark.slow
def test_a_sensor_that_is_stuck_moves_nothing(rig):
    rig.fault("stuck-force")
    before = rig.state()["height"]
    with pytest.raises(DeviceError, match=r"every axis of sensor.wrench repeats its reading .* through the standstill"):
        rig.run()
    assert rig.state()["height"] == pytest.approx(before, abs=1e-6)


@pytest.mark.slow
def test_an_offset_that_no_tip_explains(simulated):
    twin = simulated(*SHORT, "twin.bench.bias=25 N")
    before = twin.state()["height"]
    with pytest.raises(
        DeviceError, match=r"reads 2\d\.\d+ N at standstill, over \[safety\] standstill_force = 5 N: is the tip free"
    ):
        twin.run()
    assert twin.state()["height"] == pytest.approx(before, abs=1e-6)


@pytest.mark.slow
def test_a_zero_that_drifts_is_no_contact(simulated):
    """What the sensor may drift by between standstill and retreat is allowed for, and no more."""
    twin = simulated(*SHORT, "trajectory.press.duration=0.5 s", "twin.bench.drift=500 N/h")
    with pytest.raises(DeviceError, match=r"rose by 0\.\d+ N, .* when the tip retreated"):
        twin.run(out="refused")
    found = twin.run("alignment.drift=600 N/h").run["live"]["felt"]
    assert 5 * found["std"] < -found["change"] < found["drift"]


@pytest.mark.slow
def test_the_way_to_the_start_keeps_the_box(simulated):
    """The tip stands over the box, near enough to the start: nothing moves, and the doctor says it before."""
    twin = simulated(*SHORT, "twin.bench.height=25 mm")
    bad = [finding for finding in examine(twin.pipeline(), 0.2) if finding.verdict == "bad"]
    assert ["mm, above the limit of 20.00 mm" in finding.text for finding in bad] == [True]
    with pytest.raises(
        DeviceError, match=r"the way from where .* breaks the limits .*by hand:\n  z goes to 2[45]\.\d+ mm"
    ):
        twin.run()
    assert twin.state()["height"] == pytest.approx(0.025, abs=1e-5)
    well = [finding.text for finding in examine(twin.pipeline("safety.high=[5e-3, 5e-3, 26e-3]"), 0.2)]
    assert any("the way to the start of press, 22.0 mm in 2.1 s, keeps the limits" in text for text in well)


def test_a_way_that_is_too_fast_is_refused_before_anything_is_connected(rig):
    before = rig.state()["uploads"]
    with pytest.raises(ConfigurationError, match=r"\[device.arm\]: the way to the start: the speed is 50.0 mm/s"):
        rig.run("device.arm.approach_speed=50 mm/s")
    assert rig.state()["uploads"] == before
