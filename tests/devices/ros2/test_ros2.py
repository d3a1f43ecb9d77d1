"""Topics by DDS, published by a library and a program that are not ours."""

import json
import re
import time

import numpy as np
import pytest
from palpate.errors import DeviceError, PalpateError
from palpate.host import load_pipeline, run_pipeline
from palpate_devices.logs.mapping import MappedSignal
from palpate_devices.ros2.device import Ros2Device

PERIOD = 0.002  # [s]
WRENCH, POSE = "topic /wrench wrench", "topic /pose pose"
FORCE = {"topic": "/wrench", "field": "wrench.force.z", "unit": "N"}
HEIGHT = {"topic": "/pose", "field": "pose.position.z", "unit": "mm"}

pytestmark = pytest.mark.talks


def wrenches(seconds, begin=0.0, value=lambda k: float(k)):
    count = round(seconds / PERIOD)
    return [WRENCH, *(f"{begin + k * PERIOD:.6f} /wrench 0 0 {value(k)!r} 0 0 0" for k in range(count))]


def device(domain, **settings):
    signals = {"force": MappedSignal(**FORCE)}
    return Ros2Device(domain=domain, interface="lo", **{"signals": signals, "patience": 8.0, **settings})


def heard(link, seconds):
    """Stamps, arrivals and values of the first stream."""
    found, end = [], time.monotonic() + seconds
    for batch in link.batches():
        found.append(batch)
        if time.monotonic() > end:
            break
    name = next(batch.stream for batch in found if len(batch.time))
    parts = [batch for batch in found if batch.stream == name]
    return (np.concatenate([getattr(batch, key) for batch in parts]) for key in ("time", "received", "values"))


def test_every_message_comes_with_its_number_and_its_time(publish, domain):
    publish(wrenches(2.5))
    with device(domain).connect(0) as link:
        stamps, received, values = heard(link, 1.5)
        health = link.health
    numbers = values[:, 0]
    assert len(numbers) > 500
    assert (np.diff(numbers) == 1.0).all()  # none lost, none twice, in order
    step = np.diff(stamps)
    assert np.median(np.abs(step - 2e6)) < 2e4  # the stamps are those of the publisher's clock, moved as a whole
    assert (received >= stamps).all()
    assert health["topics"]["/wrench"]["missing"] == health["topics"]["/wrench"]["damaged"] == 0
    assert health["flags"] == {}


PIPELINE = """
[device.ros]
type = "ros2"
domain = {domain}
interface = "lo"
listen = "2.2 s"
patience = "8 s"
[device.ros.signals]
force = {{ topic = "/wrench", field = "wrench.force.z", unit = "N" }}
z = {{ topic = "/pose", field = "pose.position.z", unit = "m" }}
[alignment]
force = {{ channel = "ros.wrench.force", uncertainty = "1 ms" }}
position = "ros.pose.z"
tip_mass = "140 g"
tare = "none"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.kinematic]
type = "kinematic-ekf"
[sink.log]
type = "mcap"
"""


def press(seconds):
    """Wrench and pose of a 5 mm sphere that swings in S2 (E = 112.5 kPa, eta = 362 Pa s), with the paper's noise."""
    time = np.arange(0, seconds, PERIOD)
    ramp = np.clip((time - 0.6) / 0.4, 0, 1)
    swing = np.where(time > 1, 5e-4 * np.sin(4 * np.pi * (time - 1)), 0)
    height = 1e-3 - 4e-3 * ramp**2 * (3 - 2 * ramp) + swing
    speed, depth = np.gradient(height, time), np.maximum(-height, 0)
    force = 16 / 9 * 112.5e3 * np.sqrt(5e-3) * depth**1.5 - 8 * 362 * np.sqrt(5e-3 * depth) * speed
    force = force + np.random.default_rng(1).normal(0, 0.05, len(time))
    rows = zip(time.tolist(), height.tolist(), force.tolist(), strict=True)
    lines = [(f"{t:.6f} /pose 0 0 {z!r} 0 0 0 1", f"{t:.6f} /wrench 0 0 {f!r} 0 0 0") for t, z, f in rows]
    return [WRENCH, POSE, *(line for pair in lines for line in pair)]


def test_what_was_found_live_is_what_its_recording_gives_to_the_bit(publish, domain, tmp_path):
    publish(press(4.0))
    file = tmp_path / "live.toml"
    file.write_text(PIPELINE.format(domain=domain))
    result = run_pipeline(load_pipeline(file), tmp_path / "live")
    text = (result.folder / "pipeline.toml").read_text()
    table = f'[device.ros]\ntype = "mcap-replay"\nfile = "{result.folder / "log.mcap"}"\nrecorded = "ros"\n'
    tables = re.split(r"\n(?=\[)", text)
    kept = [part for part in tables if not part.startswith(("[device.ros", "[sink"))]
    again = tmp_path / "again.toml"
    again.write_text("\n".join([*kept, table]))
    replayed = run_pipeline(load_pipeline(again), tmp_path / "again")
    assert result.run["samples"] > 600
    assert (result.folder / "estimates.csv").read_bytes() == (replayed.folder / "estimates.csv").read_bytes()
    ours, theirs = (
        json.loads((r.folder / "result.json").read_text())["tracks"]["dr/kinematic"] for r in (result, replayed)
    )
    assert ours["parameters"] == theirs["parameters"]
    assert ours["parameters"]["elasticity"]["value"] == pytest.approx(112.5e3, rel=0.1)


def test_a_topic_that_is_not_there_is_told_with_those_that_are(publish, domain):
    publish(wrenches(0.1))
    signals = {"force": MappedSignal(**{**FORCE, "topic": "/wrnch"})}
    with (
        pytest.raises(DeviceError, match=r"nobody publishes /wrnch within 1 s \(there are: /wrench of geometry_msgs"),
        device(domain, signals=signals, patience=1.0).connect(0),
    ):
        pass


def test_an_empty_domain_is_told(domain):
    with (
        pytest.raises(DeviceError, match="no topics at all: is the domain right"),
        device(domain, patience=0.3).connect(0),
    ):
        pass


def test_a_field_of_another_type_is_told_by_name(publish, domain):
    publish(wrenches(6.0))
    signals = {"z": MappedSignal(**{**HEIGHT, "topic": "/wrench"})}
    with (
        pytest.raises(PalpateError, match=r"/wrench have no number 'pose.position.z' \(there are: .*wrench.force.z"),
        device(domain, signals=signals).connect(0),
    ):
        pass


def test_a_publisher_that_is_killed_and_comes_back_with_another_clock(publish, domain):
    first = publish(wrenches(1.0), times=3)
    with device(domain).connect(0) as link:
        batches, found = link.batches(), []
        begin = time.monotonic()
        second = None
        for batch in batches:
            found.append(batch)
            if first.poll() is None and time.monotonic() > begin + 0.5:
                first.kill()
                first.wait()
            if second is None and time.monotonic() > begin + 1.2:
                second = publish(wrenches(2.0, value=lambda k: 1e6 + k), offset=-3600.0)
            if sum(len(b.time) for b in found if len(b.time) and b.values[0, 0] >= 1e6) > 100:
                break
            assert time.monotonic() < begin + 20
        health = link.health
    stamps, received = (np.concatenate([getattr(b, key) for b in found]) for key in ("time", "received"))
    assert np.abs(received - stamps).max() < 60e9  # the new clock is an hour behind, and mapped anew
    assert list(health["flags"]) == ["ros2-restarted"]
    assert health["topics"]["/wrench"]["missing"] == 0


def test_of_two_publishers_the_first_is_read(publish, domain):
    publish(wrenches(4.0))
    with device(domain).connect(0) as link:
        publish(wrenches(4.0, value=lambda k: -1.0))
        _, _, values = heard(link, 1.5)
        health = link.health
    assert (values >= 0).all()
    assert list(health["flags"]) == ["ros2-publishers"]
