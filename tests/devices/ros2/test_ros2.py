"""Topics by DDS, published by a library and a program that are not ours."""

import csv
import json
import re
import time

import numpy as np
import pytest
from palpate.errors import DeviceError, PalpateError
from palpate.host import load_pipeline, run_pipeline
from palpate_devices.logs.kinematics import Kinematics
from palpate_devices.logs.mapping import MappedSignal
from palpate_devices.messages import pack
from palpate_devices.ros2.device import Ros2Device, WatchedRange
from palpate_devices.ros2.listening import hear, listener
from palpate_devices.ros2.network import Network

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


SIMULATED = """
[run]
estimates_interval = 0
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "dr"
elasticity = "112.5 kPa"
viscosity = "362 Pa*s"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "6 s"
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = "rig.tip.z"
velocity = "rig.twist.z"
lateral_x = "rig.tip.x"
lateral_y = "rig.tip.y"
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.kinematic]
type = "kinematic-ekf"
[sink.ros]
type = "ros2"
domain = {domain}
interface = "lo"
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


@pytest.mark.live
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


@pytest.mark.live
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


def test_joints_become_a_tip_and_arrays_and_own_types_are_read(publish, domain):
    robot = Kinematics(topic="/joint_states", robot="ur3e", tcp=(0.0, 0.0, 0.12))
    order = [joint.name for joint in robot.chain]
    alphabetical = sorted(order)  # as ROS sends them
    angles = np.random.default_rng(2).normal(0, 1, (1500, 6))
    lines = ["topic /joint_states joints", "topic /numbers array", "topic /load own"]
    for k, row in enumerate(angles.tolist()):
        by_name = dict(zip(order, row, strict=True))
        words = " ".join(repr(by_name[name]) for name in alphabetical)
        lines.append(f"{k * PERIOD:.4f} /joint_states {words} 0 0 0 0 0 0")
        lines += [f"{k * PERIOD:.4f} /numbers 1 2 {k}", f"{k * PERIOD:.4f} /load {k} 0.25"]
    signals = {
        "third": MappedSignal(topic="/numbers", field="data", index=2),
        "newtons": MappedSignal(topic="/load", field="newtons", unit="N"),
    }
    types = {"lab_msgs/msg/Load": "float64 newtons\nfloat64 height"}
    publish(lines)
    with device(domain, signals=signals, kinematics=robot, types=types).connect(0) as link:
        found, end = {}, time.monotonic() + 1.0
        for batch in link.batches():
            found.setdefault(batch.stream, []).append(batch.values)
            if time.monotonic() > end:
                break
    tips, third, load = (np.concatenate(found[name]) for name in ("tip", "numbers", "load"))
    assert min(map(len, (tips, third, load))) > 200
    assert (np.diff(third[:, 0]) == 1).all()
    assert (np.diff(load[:, 0]) == 1).all()
    expected = robot.pose(angles)
    first = int(np.argmin(np.abs(expected - tips[0]).sum(axis=1)))
    assert (tips == expected[first : first + len(tips)]).all()
    assert (np.concatenate(found["twist"]) == 0).all()


def test_an_own_type_without_its_definition_is_told(publish, domain):
    publish(["topic /load own", "0.0 /load 1 2"])
    signals = {"newtons": MappedSignal(topic="/load", field="newtons", unit="N")}
    with (
        pytest.raises(DeviceError, match="lab_msgs/msg/Load, which is no standard type: give its definition in types"),
        device(domain, signals=signals, patience=1.5).connect(0),
    ):
        pass


@pytest.mark.live
def test_messages_that_are_damaged_are_left_out_and_counted(publish, domain):
    """Cut, empty, a megabyte of zeros, a text of 4 GB, numbers that are none; the good ones between them all count."""
    good = pack(np.arange(1000) * 1_000_000, "ft", np.arange(6000.0).reshape(1000, 6))
    bad = [
        good[0][:20],
        good[0][:4],
        good[0] + bytes(1 << 20),
        good[0][:12] + b"\xff" * 4 + good[0][16:],
        good[0] + bytes(64),
    ]
    nan = pack(np.array([5]), "ft", np.full((1, 6), np.nan))[0]
    lines = ["topic /wrench raw"]
    for k, message in enumerate(good):
        lines.append(f"{k * PERIOD:.4f} /wrench {message.hex()}")
        if k % 100 == 50 and k > 400:
            lines.append(f"{k * PERIOD + 0.0005:.4f} /wrench {[*bad, nan][k // 100 - 4].hex()}")
    publish(lines)
    with device(domain).connect(0) as link:
        _, _, values = heard(link, 2.2)
        health = link.health
    numbers = values[np.isfinite(values[:, 0]), 0]
    assert set(np.diff(numbers)) == {6.0}
    assert numbers[-1] == 6 * 999 + 2
    assert np.count_nonzero(np.isnan(values)) == 1
    # What is cut DDS drops by itself; a megabyte in pieces may be lost on its way.
    assert 1 <= health["topics"]["/wrench"]["damaged"] <= 2
    assert "ros2-damaged" in health["flags"]


@pytest.mark.live
def test_a_limit_is_flagged_and_alarmed_and_stops_nothing(publish, domain):
    publish(wrenches(3.0))
    limits = {"force": WatchedRange(greatest="700 N")}
    alarm, network = "/palpate/alarm", Network(domain, "lo")
    with (
        listener("listener", network, [alarm], {}) as source,
        device(domain, limits=limits, alarm=alarm).connect(0) as link,
    ):
        _, _, values = heard(link, 1.8)
        said = hear(source, {}, 1.0, lambda heard: False)
        flags = link.health["flags"]
    assert values[-1, 0] > 700  # nothing was stopped
    assert list(flags) == ["ros2-limit"]
    assert [messages.payload(0)[4] for _, messages in said.blocks({alarm})] == [1]  # true


def test_what_is_found_is_published(domain, tmp_path, decoded):
    file = tmp_path / "simulated.toml"
    text = SIMULATED.format(domain=domain)
    file.write_text(text)
    with listener("listener", Network(domain, "lo"), None, {}) as source:
        result = run_pipeline(load_pipeline(file), tmp_path / "run")
        said = hear(source, {}, 1.0, lambda heard: False)
    base = "/palpate/dr/kinematic"
    assert {f"{base}/elasticity", f"{base}/viscosity", "/palpate/flags"} <= set(said.topics)
    ((_, messages),) = said.blocks({f"{base}/elasticity"})
    vectors = [decoded("geometry_msgs/msg/Vector3Stamped", messages.payload(k)).vector for k in range(len(messages))]
    with (result.folder / "estimates.csv").open() as table:
        rows = {round(float(row["time_s"]), 6): row for row in csv.DictReader(table)}
    compared = [(vector, rows[round(vector.z, 6)]) for vector in vectors if round(vector.z, 6) in rows]
    assert len(compared) > 5
    column = next(name for name in compared[0][1] if "elasticity" in name and "std" not in name)
    assert all(float(row[column]) == pytest.approx(vector.x, rel=1e-6) for vector, row in compared)


@pytest.mark.live
def test_of_two_publishers_the_first_is_read(publish, domain):
    publish(wrenches(4.0))
    with device(domain).connect(0) as link:
        publish(wrenches(4.0, value=lambda k: -1.0))
        _, _, values = heard(link, 1.5)
        health = link.health
    assert (values >= 0).all()
    assert list(health["flags"]) == ["ros2-publishers"]
