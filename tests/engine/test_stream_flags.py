"""Faults of readings, by stream: those that the streams of a device share are one flag."""

import pytest
from palpate import Channel, Stream
from palpate.stream_health import Health
from palpate_engine.result.record_flags import _stream_flags


@pytest.mark.parametrize(
    ("gaps", "messages"),
    [
        ({"arm.tip": 1, "arm.twist": 1, "arm.joints": 1}, ["arm.tip, twist and joints have 1 gap"]),
        ({"arm.tip": 1, "arm.twist": 2}, ["arm.tip has 1 gap", "arm.twist has 2 gaps"]),
        ({"arm.tip": 1, "sensor.wrench": 1}, ["arm.tip has 1 gap", "sensor.wrench has 1 gap"]),
        ({"arm.tip": 0, "arm.twist": 0}, []),
    ],
    ids=["one lost state", "two causes", "two devices", "sound"],
)
def test_one_lost_state_is_one_flag(gaps, messages):
    stream = Stream("states", (Channel("z", "m"),), 500.0)
    streams = {name: Health(stream, gaps=count) for name, count in gaps.items()}
    assert [flag.message for flag in _stream_flags(streams)] == messages
