"""Every kind of topic that laboratories publish, and every way to find them, by a publisher that is not ours."""

import time

import numpy as np
import pytest
from palpate.errors import DeviceError
from palpate_records.messages.channel_mapping import MappedSignal
from palpate_ros2.device import Ros2Device

PERIOD = 0.002  # [s]
pytestmark = [pytest.mark.talks, pytest.mark.slow]


def device(domain, **settings):
    usual = {"interface": "lo", "patience": 8.0}
    signals = {name: MappedSignal(**signal) for name, signal in settings.pop("signals").items()}
    return Ros2Device(domain=domain, signals=signals, **{**usual, **settings})


def heard(link, enough=100, streams=1):
    """Values by stream, once each of so many streams has enough."""
    found, end = {}, time.monotonic() + 15
    for batch in link.batches():
        found.setdefault(batch.stream, []).append(batch.values)
        if len(found) >= streams and all(sum(map(len, parts)) >= enough for parts in found.values()):
            break
        assert time.monotonic() < end
    return {name: np.concatenate(parts) for name, parts in found.items()}


def lines(name, kind, numbers, count=2000, how=""):
    return [f"topic {name} {kind} {how}", *(f"{k * PERIOD:.4f} {name} {numbers(k)}" for k in range(count))]


KINDS = {  # type: numbers of a message, the one that is read, how it is chosen
    "bare": ("0 0 {k} 0 0 0", "force.z", {}),
    "wrench": ("0 0 0 {k} 0 0", "wrench.torque.x", {}),
    "twist": ("0 0 {k} 0 0 0", "twist.linear.z", {}),
    "pose": ("0 {k} 0 0 0 0 1", "pose.position.y", {}),
    "number": ("{k}", "data", {}),
    "array": ("5 6 {k}", "data", {"index": 2}),
    "joints": ("0 0 0 {k} 0 0 0 0 0 0 0 0", "position", {"select": "wrist_1_joint"}),
    "frames": ("0 0 {k} 0 0 0 1", "transforms.transform.translation.z", {"select": "tool0"}),
}


def test_every_kind_of_message_is_read_with_all_its_numbers_in_order(publish, domain):
    kinds = [(kind, numbers) for kind, (numbers, _, _) in KINDS.items()]
    sent = [f"{k * PERIOD:.4f} /{kind} {text.format(k=k)}" for k in range(1500) for kind, text in kinds]
    publish([*(f"topic /{kind} {kind}" for kind in KINDS), *sent])
    signals = {kind: {"topic": f"/{kind}", "field": field, **more} for kind, (_, field, more) in KINDS.items()}
    with device(domain, signals=signals).connect(0) as link:
        found = heard(link, streams=len(KINDS))
        flags = link.health["flags"]
    names = [more.get("select", kind) for kind, (_, _, more) in KINDS.items()]
    assert {name: set(np.diff(values[:, 0])) for name, values in found.items()} == {name: {1.0} for name in names}
    assert flags == {}


FORCE = {"topic": "/wrench", "field": "wrench.force.z", "unit": "N"}


def wrenches(name="/wrench", how=""):
    return lines(name, "wrench", lambda k: f"0 0 {k} 0 0 0", 3000, how)


def test_without_multicast_the_peers_that_are_named_are_found(publish, domain):
    publish(wrenches(), UNICAST="1")
    with device(domain, signals={"force": FORCE}, peers=("127.0.0.1",)).connect(0) as link:
        assert (np.diff(heard(link)["wrench"][:, 0]) == 1).all()


def test_topics_of_a_namespace_are_those_of_one_arm(publish, domain):
    publish(wrenches("/right/wrench"))
    publish(wrenches("/left/wrench"))
    with device(domain, signals={"force": {**FORCE, "topic": "wrench"}}, namespace="/left").connect(0) as link:
        assert (np.diff(heard(link)["wrench"][:, 0]) == 1).all()


def test_best_effort_is_read_unless_more_is_asked_for(publish, domain):
    publish(wrenches(how="best-effort"))
    with device(domain, signals={"force": FORCE}).connect(0) as link:
        assert len(heard(link)["wrench"]) >= 100
    told = '/wrench is published best effort, and reliability = "reliable" requires more'
    with (
        pytest.raises(DeviceError, match=told),
        device(domain, signals={"force": FORCE}, reliability="reliable", patience=1.5).connect(0),
    ):
        pass


def test_reliable_is_read_reliable(publish, domain):
    publish(wrenches())
    with device(domain, signals={"force": FORCE}, reliability="reliable").connect(0) as link:
        assert (np.diff(heard(link)["wrench"][:, 0]) == 1).all()
        assert link.health["flags"] == {}


def test_a_publisher_that_comes_back_with_another_type_is_told(publish, domain):
    first = publish(wrenches())
    with device(domain, signals={"force": FORCE}).connect(0) as link:
        begin, second = time.monotonic(), None
        for _ in link.batches():
            if second is None and time.monotonic() > begin + 0.3:
                first.kill()
                first.wait()
                second = publish(lines("/wrench", "bare", lambda k: "0 0 0 0 0 0"))
            if "ros2-unread" in link.health["flags"]:
                break
            assert time.monotonic() < begin + 10
        flags = link.health["flags"]
    told = "/wrench is published as geometry_msgs/msg/Wrench, and read as geometry_msgs/msg/WrenchStamped"
    assert flags["ros2-unread"] == told
