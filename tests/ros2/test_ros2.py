"""Topics by DDS, published by a library and a program that are not ours."""

import time

import numpy as np
import pytest
from palpate.errors import DeviceError, PalpateError
from palpate_devices.messages import pack
from palpate_kit.logs.joint_kinematics import Kinematics
from palpate_records.messages.channel_mapping import MappedSignal
from palpate_ros2.device import Ros2Device, WatchedRange
from palpate_ros2.listener import hear, listener
from palpate_ros2.network import Network

PERIOD = 0.002  # [s]
WRENCH = "topic /wrench wrench"
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


@pytest.mark.slow
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


def test_a_topic_that_is_not_there_is_told_with_those_that_are(publish, domain):
    publish(wrenches(0.1))
    signals = {"force": MappedSignal(**{**FORCE, "topic": "/wrnch"})}
    with (
        pytest.raises(DeviceError, match=r"/wrnch is not published within 1 s \(there are: /wrench of geometry_msgs"),
        device(domain, signals=signals, patience=1.0).connect(0),
    ):
        pass


@pytest.mark.slow
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


@pytest.mark.slow
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
    idl = "module lab_msgs { module msg { struct Load { double newtons; double height; }; }; };"
    types = {"lab_msgs/msg/Load": idl}  # a .msg would do as well
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
        pytest.raises(DeviceError, match="lab_msgs/msg/Load, which is not a standard type: give its definition"),
        device(domain, signals=signals, patience=1.5).connect(0),
    ):
        pass


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_limit_is_flagged_and_alarmed_and_stops_nothing(publish, domain):
    publish(wrenches(3.0))
    limits = {"force": WatchedRange(greatest="700 N")}
    alarm, network = "/palpate/alarm", Network(domain, "lo")
    with (
        listener("listener", network, [alarm], {}) as source,
        device(domain, limits=limits, alarm=alarm).connect(0) as link,
    ):
        _, _, values = heard(link, 1.8)
        snapshot = hear(source, {}, 1.0, is_complete=lambda snapshot: False)
        flags = link.health["flags"]
    assert values[-1, 0] > 700  # nothing was stopped
    assert list(flags) == ["ros2-limit"]
    assert [messages.payload(0)[4] for _, messages in snapshot.blocks({alarm})] == [1]  # true


@pytest.mark.slow
def test_of_two_publishers_the_first_is_read(publish, domain):
    publish(wrenches(4.0))
    with device(domain).connect(0) as link:
        publish(wrenches(4.0, value=lambda k: -1.0))
        _, _, values = heard(link, 1.5)
        health = link.health
    assert (values >= 0).all()
    assert list(health["flags"]) == ["ros2-publishers"]
