"""Somebody else's driver whose stream ends, one way or another, while an arm moves."""

import json

import pytest
from palpate.errors import DeviceError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline

from tests.engine import live

LONG = "trajectory.press.duration=30 s"


@pytest.fixture
def run(stage, tmp_path):
    """Run the live rig beside a sensor whose stream ends."""

    def go(*overrides, needed=True, **settings):
        text = live.PIPELINE.format(plugin="live_parts.py")
        text = text.replace("rig.wrench.z", "sensor.wrench.z") if needed else text
        table = "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
        (tmp_path / "ending.toml").write_text(f'{text}\n[device.sensor]\ntype = "ending"\n{table}')
        return run_pipeline(load_pipeline(tmp_path / "ending.toml", overrides), tmp_path / "out")

    return go


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("ending", "words"),
    [
        ("returns", "the stream of sensor has ended: sensor.wrench.z can no longer be watched"),
        ("SystemExit", "device sensor failed: SystemExit: by the driver"),
        ("KeyboardInterrupt", "KeyboardInterrupt: by the driver"),
        ("GeneratorExit", "GeneratorExit: by the driver"),
    ],
)
def test_a_force_that_is_no_longer_sent_makes_the_arm_retract(run, tmp_path, ending, words):
    with pytest.raises(DeviceError) as caught:
        run(LONG, ending=ending)
    assert words in str(caught.value)
    stop = json.loads((tmp_path / "out" / "result.json").read_text())["run"]["live"]["stop"]
    assert words in stop["reason"]
    when, what = live.LINKS[0].stops[0]
    assert what == "retract"
    assert abs(when - stop["monotonic"]) < 1.0  # of a motion of 30 s


def test_a_driver_that_raises_stops_the_arm_although_no_check_needs_it(run):
    with pytest.raises(DeviceError, match="device sensor failed: SystemExit"):
        run(LONG, ending="SystemExit", needed=False)
    assert live.LINKS[0].stops[0][1] == "retract"


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("ending", "words"),
    [
        ("stream", "device sensor sends a stream 'wrnch'; did you mean"),
        ("columns", "device sensor sends values of shape"),
    ],
)
def test_a_driver_that_sends_what_it_has_not_declared_stops_the_arm(run, tmp_path, ending, words):
    with pytest.raises(DeviceError) as caught:
        run(LONG, ending=ending, needed=False)
    assert words in str(caught.value)
    assert live.LINKS[0].stops[0][1] == "retract"
    assert words in json.loads((tmp_path / "out" / "result.json").read_text())["run"]["live"]["stop"]["reason"]


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("lasts", [pytest.param(0.05, marks=pytest.mark.slow), 1.0], ids=["at standstill", "in motion"])
def test_a_stream_that_no_check_needs_is_flagged_where_it_ends(run, lasts):
    result = run(needed=False, lasts=lasts)
    assert result.interrupted is None
    assert [flag.message for flag in result.flags if flag.code == "ended-early"] == [
        "sensor sent its last reading before the motion was over"
    ]
    assert [what for _, what in live.LINKS[0].stops] == ["stop"]  # at the end, as always
