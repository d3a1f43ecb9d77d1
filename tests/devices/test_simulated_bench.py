"""A whole live run in simulated time: the same every time, and what a busy computer makes of it."""

import json

import pytest
from palpate import clock
from palpate.twin import HoldUp
from palpate_devices.bota.device import BotaSensor
from palpate_devices.ur.device import UR


@pytest.mark.slow
def test_two_runs_are_the_same_to_the_bit(simulated, tmp_path):
    from tests.devices.simulated_bench import SHORT

    for folder in "ab":
        twin = simulated(*SHORT)
        twin.run(out=folder)
        twin.close()
    for name in ("estimates.csv", "log.mcap", "pipeline.toml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    one, other = (json.loads((tmp_path / folder / "result.json").read_text()) for folder in "ab")
    assert one["run"].pop("started") <= other["run"].pop("started")  # when they were made, by the calendar
    assert one == json.loads(json.dumps(other).replace(f'"{tmp_path}/b"', f'"{tmp_path}/a"'))


@pytest.mark.slow
@pytest.mark.parametrize(("process", "duration"), [("robot", 0.008), ("robot", 0.05), ("sensor", 0.05), ("main", 0.05)])
def test_a_short_hold_up_ends_nothing(simulated, process, duration):
    from tests.devices.simulated_bench import SHORT

    twin = simulated(*SHORT, hold_ups=[HoldUp(process, duration, first=1.5, every=0.7)])
    result = twin.run()
    assert result.tracks["dr/kinematic"].parameters["elasticity"].value == pytest.approx(112.5e3, rel=0.03)
    assert twin.truth.speed < 0.04
    assert not twin.truth.moving


@pytest.mark.slow
@pytest.mark.parametrize("hold_up", [HoldUp("robot", 0.014, 0.33, 0.2), HoldUp("sensor", 0.06, 0.33, 0.3)])
def test_an_arm_that_starts_again_on_its_way_down_touches_once(simulated, hold_up):
    """It sets the mass of the tip in motion: 0.2 N, as much as counts as touch.

    The first motion begins 0.33 s late, after the arm has answered the question whether it obeys.
    """
    from tests.devices.simulated_bench import SHORT

    soft = "twin.bench.specimen.elasticity=20 kPa", "twin.bench.specimen.viscosity=60 Pa*s"
    result = simulated(*SHORT, *soft, "alignment.tare_duration=0.9 s", hold_ups=[hold_up]).run()
    told = json.loads((result.folder / "result.json").read_text())
    assert "touched-again" not in json.dumps(told["tracks"])
    assert told["run"]["first_touch"]["position"] == pytest.approx(0.3e-3, abs=0.4e-3)


def test_a_robot_can_be_commanded_after_another_connection_commanded_it(rig):
    for _ in range(2):
        with UR.model_validate({"host": rig.host, "work": {"origin": (-0.3, -0.13, 0.1)}}).connect(0) as link:
            batches, deadline = link.batches(), clock().now() + 0.2
            while clock().now() < deadline:  # a program that was stopped is an error here
                next(batches)


def test_a_sensor_starts_anew_at_each_opening(rig):
    for _ in range(2):
        with BotaSensor.model_validate({"port": str(rig.port), "settle": "0.1 s"}).connect(0) as link:
            assert "S/N: 000000" in link.health["identity"]
