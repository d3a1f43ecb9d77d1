"""The SensONE: frames, decoder, clock, and the device against its twin."""

import json
import re

import numpy as np
import pytest
from palpate import ConfigurationError, DeviceError
from palpate_devices.bota.device import BotaSensor
from palpate_kit.acquisition.device_clock import ClockMap
from palpate_kit.protocols.bota_frames import LENGTH, FrameDecoder, TimestampUnwrapper, crc_x25, pack_frame
from palpate_simulation.twins.frame_corruption import KINDS, corrupt_frame, is_intact

pytestmark = pytest.mark.talks

FIRST = bytes.fromhex(
    "aa 00 00 00 00 80 3f 00 00 00 40 00 00 40 40 cd cc cc 3d cd cc 4c 3e 9a 99 99 3e 15 cd 5b 07 00 00 cc 41 5e bf"
)
SECOND = bytes.fromhex(
    "aa 02 00 00 00 00 00 00 00 00 00 00 00 a8 c0 00 00 00 00 00 00 00 00 00 00 00 00 ff ff ff ff 66 66 12 42 69 d4"
)


def test_known_frames():
    assert crc_x25(b"123456789") == 0x906E
    assert pack_frame(0, (1, 2, 3, 0.1, 0.2, 0.3), 123456789, 25.5) == FIRST
    (frame,) = FrameDecoder().feed(FIRST + FIRST)[:1]
    assert frame.wrench == pytest.approx((1, 2, 3, 0.1, 0.2, 0.3))
    assert (frame.status, frame.stamp, frame.temperature) == (0, 123456789, 25.5)
    frame = FrameDecoder().feed(SECOND + SECOND)[0]
    assert (frame.status, frame.wrench[2], frame.stamp) == (2, -5.25, 0xFFFFFFFF)


def stream(kind, frames, rng, part=0.05):
    """Bytes of many frames, some damaged; the time-stamps of those that are intact, and of those that are not."""
    data, intact, damaged = bytearray(), [], set()
    wrench = rng.normal(0, 5, (frames, 6))
    for i in range(frames):
        stamp = (4294000000 + 1250 * i) % (1 << 32)  # wraps on the way
        frame = pack_frame(0, tuple(wrench[i]), stamp, 30.0)
        if 10 < i < frames - 10 and rng.random() < part:
            frame = corrupt_frame(frame, kind, rng)
            (intact.append if is_intact(kind) else damaged.add)(stamp)
        else:
            intact.append(stamp)
        data += frame
    return bytes(data), intact, damaged


@pytest.mark.parametrize("kind", KINDS)
def test_no_intact_frame_is_lost_and_no_damaged_one_taken(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    data, intact, damaged = stream(kind, 4000, rng)
    decoder, found, at = FrameDecoder(), [], 0
    while at < len(data):
        size = int(rng.integers(1, 200))
        found += [frame.stamp for frame in decoder.feed(data[at : at + size])]
        at += size
    # A frame that got bytes inserted behind its CRC, or was cut by nothing, may have survived after all.
    assert [stamp for stamp in found if stamp not in damaged] == intact
    assert sum(stamp in damaged for stamp in found) == 0
    assert len(damaged) > 100 or is_intact(kind)


def test_it_begins_in_the_middle():
    frames = [pack_frame(0, (1.0,) * 6, 1250 * i, 30.0) for i in range(1, 20)]
    data = b"".join(frames)
    for cut in range(1, LENGTH):
        found = [frame.stamp for frame in FrameDecoder().feed(data[cut:])]
        assert found == [1250 * i for i in range(2, 20)]


def test_the_counter_wraps_and_restarts():
    clock = TimestampUnwrapper()
    assert [clock.add(s) for s in (4294967000, 954, 2204)] == [0, 1250, 2500]
    assert clock.add(100) is None


def test_the_clock_map_finds_the_smallest_delay():
    rng = np.random.default_rng(1)
    device = np.arange(40_000, dtype=np.int64) * 1_250_000
    true = 1_700_000_000_000_000_000 + np.rint(device * (1 + 80e-6)).astype(np.int64)
    received = true + np.rint(rng.exponential(1e6, len(device)) + 1e5).astype(np.int64)
    received = np.maximum.accumulate(received)
    whole, parts = ClockMap(), ClockMap()
    mapped = whole.to_host(device, received)
    pieces = [parts.to_host(device[i : i + 7], received[i : i + 7]) for i in range(0, len(device), 7)]
    np.testing.assert_array_equal(np.concatenate(pieces), mapped)
    assert (np.diff(mapped) > 0).all()
    error = (mapped - true)[800:] / 1e9
    assert error.min() > 0
    assert error.max() < 0.25e-3  # 0.1 ms of it is the smallest delay, which nobody can know


@pytest.mark.parametrize("seed", range(5))
def test_the_clock_map_takes_lumps_for_what_they_are(seed):
    """An adapter that passes frames on every 16 ms: after two lumps the time is that of the sensor's clock."""
    rng = np.random.default_rng(seed)
    device = np.arange(800, dtype=np.int64) * 1_250_000
    lump = np.ceil((device + rng.uniform(0, 16e6)) / 16e6) * 16e6
    received = (lump + 1e5 + np.repeat(rng.exponential(5e4, 800), 1)).astype(np.int64)
    mapped = ClockMap().to_host(device, np.maximum.accumulate(received))
    np.testing.assert_allclose(np.diff(mapped[40:]), 1.25e6, atol=0.3e6)


def gathered(device, count):
    with device.connect(0) as link:
        found = []
        for batch in link.batches():
            if batch.stream == "wrench":
                found.append(batch)
            if sum(len(batch.time) for batch in found) > count:
                return np.concatenate([b.time for b in found]), np.concatenate([b.values for b in found]), link.health
    return None


def sensor(twin, **changes):
    """The twin's sensor, with patience for a machine that is busy."""
    return BotaSensor.model_validate({"port": str(twin.port), "settle": 0.1, "sensor_timeout": 5.0, **changes})


@pytest.mark.slow
def test_rate_noise_and_identity_come_from_the_sensor(restored):
    device = sensor(restored, sinc=128)
    stamps, wrench, health = gathered(device, 200)
    late = stamps[len(stamps) // 2 :]  # the first readings may have waited, and the clock's map with them
    assert np.median(np.diff(late)) == pytest.approx(128 / 51200 * 1e9, rel=1e-3)
    assert wrench[:, 2].std() == pytest.approx(0.05 * 2**-0.72, rel=0.25)
    assert "software" in health["identity"]


@pytest.mark.slow
def test_corruption_on_the_line_is_counted_and_nothing_else_is_lost(restored):
    restored.fault("corrupt 0.02")
    before = restored.state()["frames"]
    stamps, wrench, health = gathered(sensor(restored), 800)
    assert health["damaged"] > 2
    assert np.isfinite(wrench).all()
    steps = np.rint(np.diff(stamps) / 1.25e6)
    assert (steps - 1).sum() < 0.02 * 800 * 2  # only the damaged ones are missing
    assert restored.state()["frames"] > before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"port": "/tmp/palpate-no-such-port"}, "cannot be opened"),
        ({"refuse": "f"}, "refuses the command 'f,64,0,0,1' with code 1"),
        ({"sinc": 40}, "refuses the command 'f,40,0,0,1' with code 2"),
    ],
)
def test_start_faults_are_told_in_words(restored, changes, words):
    if "refuse" in changes:
        restored.fault(f"refuse {changes.pop('refuse')}")
    device = sensor(restored, **changes)
    with pytest.raises(DeviceError, match=re.escape(words)):
        gathered(device, 10)


@pytest.mark.slow
def test_a_wrong_baud_rate_is_suspected(restored):
    device = sensor(restored, baud=115200, boot=0.5)
    with pytest.raises(DeviceError, match=r"\d+ bytes that contain no answer came at 115200 baud; check .* baud rate"):
        gathered(device, 10)


@pytest.mark.slow
def test_a_slow_sensor_is_waited_for(restored):
    restored.fault("slow 1.0")
    stamps, wrench, _ = gathered(sensor(restored), 50)
    assert len(stamps) > 50
    assert np.isfinite(wrench).all()


@pytest.mark.slow
def test_a_port_that_somebody_reads_is_refused(restored):
    device = sensor(restored)
    with (
        device.connect(0),
        pytest.raises(DeviceError, match=r"port /dev/.* is in use by `.*; one device serves one run"),
    ):
        gathered(device, 10)


@pytest.mark.slow
def test_lumps_and_left_out_measurements_lose_nothing(restored):
    """An adapter with a latency timer of 16 ms: every reading comes."""
    restored.fault("lumps 0.016")
    restored.fault("throttled")
    stamps, wrench, health = gathered(sensor(restored), 400)
    assert np.isfinite(wrench).all()
    assert np.diff(stamps).max() < 1.9 * 1.25e6  # none missing
    assert health["throttled"] == health["readings"]
    assert health["unusable"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["overrange", "saturated", "raw"])
def test_readings_that_the_sensor_does_not_vouch_for_are_none(restored, fault):
    """Not a number, on which the guard stops a motion; `test_live` has one of the three in contact."""
    restored.fault(fault)
    _, wrench, health = gathered(sensor(restored), 50)
    assert np.isnan(wrench).all()
    assert health["unusable"] == health["readings"]


@pytest.mark.slow
def test_settings_are_json(restored):
    device = BotaSensor(port="x")
    json.dumps(device.model_dump())
    with pytest.raises(ConfigurationError, match="is not one of 9600"):
        BotaSensor(port="x", baud=1200)


@pytest.mark.slow
def test_the_points_of_a_clock_that_are_kept_do_not_grow_with_the_hours():
    """Four hours of a clock that is 20 ppm fast and strays by a millisecond: as far from an even one as by all."""
    device = np.arange(0, 4 * 3600 * 10**9, 200_000_000, np.int64)
    stray = 0.5e6 * np.sin(2 * np.pi * device / 1.8e12)
    clock = ClockMap()
    clock.to_host(device, device + np.round(20e-6 * device + stray).astype(np.int64))
    assert 1000 < len(clock._kept) < 4096
    assert clock.deviation == pytest.approx(0.5e-3, rel=0.1)
