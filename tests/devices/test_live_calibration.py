"""`palpate calibrate` with the drivers against the twins: what is hidden there is found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate.errors import ConfigurationError
from palpate_calibration.calibration_use import identity_in
from palpate_calibration.guided_calibration import Guide, run_calibration
from palpate_calibration.plan import load_plan

PIPELINE = Path(__file__).parents[2] / "pipelines" / "calibrate_ur3e.toml"
# The real bench of point_ur3e.toml, with what nobody knows hidden in it.
HIDDEN = (
    "twin.bench.tip_mass=181 g",
    "twin.bench.force_delay=7.3 ms",
    "twin.bench.bias=0.6 N",
    'twin.bench.centre_of_mass=["2 mm", "-1 mm", "35 mm"]',
    "twin.bench.height=30 mm",
)
NEAR = 'twin.bench.work.origin=["-220 mm", "-130 mm", "100 mm"]'  # where the arm can turn by 60 degrees
QUICK = (
    "calibration.repeats=1",
    "calibration.standstill.trajectory.duration=2.5 s",
    "calibration.orientations.duration=1 s",
    "calibration.shake.trajectory.duration=5 s",
)


def plan_for(twin, *overrides):
    sets = [f"device.arm.host={twin.host}", f"device.sensor.port={twin.port}", *overrides]
    return load_plan(PIPELINE, sets)


@pytest.mark.slow
def test_what_is_hidden_in_the_twins_is_found(simulated):
    """Timing within what the drivers' clocks leave open, 0.3 ms; the rest within three standard uncertainties.

    Over 20 s, for all steps of the guide.
    """
    twin = simulated(*HIDDEN)
    said = []

    def person(text):
        said.append(text)
        words = text.partition("(")[2].partition(")")[0].replace(",", " ") if "gravity" in text else "0 0 -1"
        twin.fault(f"turn {words}")

    plan = plan_for(twin, *QUICK)
    plan = replace(plan, settings=plan.settings.model_copy(update={"noise": None}))
    calibration, session, _ = run_calibration(plan, Guide(ask=person))
    values = session.values
    assert abs(values["delay"].value - 7.3e-3) < 3e-4 + 2 * values["delay"].combined
    assert values["mass"].value == pytest.approx(0.181, abs=2e-3 + 3 * values["mass"].combined)
    assert abs(values["mass_by_weight"].value - 0.181) < 3 * values["mass_by_weight"].combined
    assert abs(values["centre_z"].value - 0.035) < 3.5 * values["centre_z"].combined
    assert values["offset"].value == pytest.approx(0.6 - 0.181 * 9.80665, abs=0.02)
    assert values["weight"].value == pytest.approx(0.181 * 9.80665, abs=0.04)
    assert values["force_std"].value == pytest.approx(0.05, rel=0.15)
    assert sum("orientation" in text for text in said) == 4
    assert calibration.devices["arm"]["serial"] == "20233500001"
    assert "S/N" in calibration.devices["sensor"]["identity"]
    assert {"force", "position", "velocity"} == set(calibration.spectra)


def test_limits_are_checked_before_anything_connects(tmp_path):
    plan = load_plan(PIPELINE, ["device.arm.host=127.255.1.1", "calibration.shake.trajectory.amplitude=10 mm"])
    with pytest.raises(ConfigurationError, match=r"\[calibration.shake\] top_speed: the motion reaches 0.314 m/s"):
        run_calibration(plan)
    plan = load_plan(PIPELINE, ["device.arm.host=127.255.1.1", "safety.acceleration=3 m/s^2"])
    with pytest.raises(ConfigurationError, match=r"breaks the limits of \[safety\]"):
        run_calibration(plan)


def test_what_says_which_device_it_is():
    facts = {"serial": "A1", "identity": "S/N: 7", "states": 12, "clock": "x"}
    assert identity_in(facts) == {"serial": "A1", "identity": "S/N: 7"}


@pytest.mark.slow
def test_the_noise_at_standstill_and_the_devices_are_found(simulated, tmp_path):
    text = PIPELINE.read_text()
    others, after = text.index("[calibration.orientations]"), text.index("[alignment]")
    (tmp_path / "standstill.toml").write_text(text[:others] + text[after:])
    simulated(*HIDDEN)
    sets = ["calibration.standstill.trajectory.duration=2.5 s", "calibration.repeats=1"]
    calibration, session, _ = run_calibration(load_plan(tmp_path / "standstill.toml", sets))
    assert session.values["force_std"].value == pytest.approx(0.05, rel=0.15)
    assert calibration.devices["arm"]["serial"] == "20233500001"
    assert "S/N: 000000" in calibration.devices["sensor"]["identity"]


@pytest.mark.slow
def test_how_the_sensor_is_mounted_is_found_where_the_arm_itself_is_turned(simulated, tmp_path):
    """The sensor is turned by 30 degrees about the flange, and the arm leads it to four orientations."""
    text = PIPELINE.read_text()
    begin, end, after = (text.index(f"[{name}") for name in ("calibration]", "calibration.shake", "alignment]"))
    step = text[begin:end].partition("[calibration.orientations]")[2]
    steps = f"[calibration]\n[calibration.orientations]{step}"
    near = (text[:begin] + steps + text[after:]).replace('origin = ["-300 mm"', 'origin = ["-220 mm"')
    (tmp_path / "turned.toml").write_text(near)
    mounting = np.array([np.pi * np.cos(np.pi / 12), np.pi * np.sin(np.pi / 12), 0.0])
    hidden = f"twin.bench.mounting={mounting.tolist()}"
    twin = simulated(*HIDDEN, hidden, NEAR)
    turns = iter(["0 0 0", "0 -25 0", "-25 0 0", "0 25 0"])

    def person(text):
        twin.fault(f"start 0 0 30 {next(turns)}")
        twin.fault("restore")

    plan = load_plan(tmp_path / "turned.toml", ["calibration.orientations.duration=1 s"])
    _, session, _ = run_calibration(plan, Guide(ask=person))
    values = session.values
    for axis, value in zip("xyz", mounting, strict=True):
        assert abs(values[f"mounting_{axis}"].value - value) < 3.5 * values[f"mounting_{axis}"].combined
        assert values[f"mounting_{axis}"].combined < 0.03
    assert abs(values["mass_by_weight"].value - 0.181) < 3 * values["mass_by_weight"].combined
