"""Topics of rmw_zenoh, published by a program that is not palpate's."""

import contextlib
import json
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from subprocess import PIPE

import numpy as np
import pytest
from palpate.errors import ConfigurationError, DeviceError
from palpate_engine import load_pipeline, run_pipeline
from palpate_records.messages.channel_mapping import MappedSignal
from palpate_ros2.device import Ros2Device, WatchedRange
from palpate_ros2.domain_survey import address_of
from palpate_ros2.network import Network, Publication
from palpate_ros2.sink import Ros2Sink
from palpate_ros2.type_hash import type_hash
from palpate_ros2.zenoh_names import attachment, identity, publication_of, publisher_token, read_attachment
from pydantic import ValidationError

from tests.ros2 import playing

zenoh = pytest.importorskip("zenoh")
pytest.importorskip("zenoh.ext")
pytestmark = pytest.mark.talks
SOURCE = Path(__file__).with_name("zenoh_publisher.py")
WRENCH = {
    "name": "/ft/wrench",
    "type": "geometry_msgs::msg::dds_::WrenchStamped_",
    "hash": "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    "qos": "::,7:,:,:,,",
    "stamped": True,
}
PERIOD = 0.002  # [s]
LONG = 120.0  # [s] for what takes a second, on a machine that is busy
HALF_A_MINUTE = 30.0  # [s] of messages, so that some are left once a busy machine has connected
# The token and the hash of rmw_zenoh's own description (docs/design.md).
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Bool", "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"),
        ("geometry_msgs/msg/Vector3Stamped", "d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a"),
        ("sensor_msgs/msg/PointCloud2", "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"),
        ("diagnostic_msgs/msg/DiagnosticArray", "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ],
)
def test_hashes_of_what_is_published_are_those_of_jazzy(name, value):
    assert type_hash(name) == f"RIHS01_{value}"


def test_a_token_of_rmw_zenoh_is_read_and_written():
    found = publication_of(TALKER)
    assert found == Publication("/chatter", "std_msgs/msg/String", TALKER, "8b20917502ee955ac4476e0266340d5c", True)
    kind = f"std_msgs::msg::dds_::String_/{type_hash('std_msgs/msg/String')}"
    ours = publisher_token(2, "8b20917502ee955ac4476e0266340d5c", 10, "talker", "/chatter", kind, False)
    assert ours == TALKER.replace("::,7:", "::,10:")
    assert not publication_of(TALKER.replace("::,7:", "2:,7:")).reliable


@pytest.mark.parametrize("token", ["@ros2_lv/0/a/0/0/NN/%/%/node", TALKER.replace("MP", "MS"), "", "a/b", TALKER + "/"])
def test_what_is_no_publisher_is_none(token):
    assert publication_of(token) is None


def test_what_goes_with_a_message_is_33_bytes_and_read_again():
    raw = attachment(3, 1_700_000_000_123_456_789, identity(TALKER))
    assert len(raw) == 33
    assert read_attachment(raw) == (1_700_000_000_123_456_789, struct.unpack("<Q", identity(TALKER)[:8])[0])


@pytest.mark.parametrize("raw", [b"", b"x" * 33, b"\0" * 17, attachment(1, 1, b"ab"), attachment(1, 1, b"a" * 16)[:-1]])
def test_what_else_goes_with_a_message_says_nothing(raw):
    assert read_attachment(raw) is None


def packed(number):
    """A WrenchStamped as CDR, packed by hand: encapsulation, stamp, frame "ft", padding, six numbers."""
    return (b"\0\1\0\0" + struct.pack("<iII", 0, 0, 3) + b"ft\0\0" + struct.pack("<6d", 0, 0, number, 0, 0, 0)).hex()


def wrenches(seconds=HALF_A_MINUTE, first=0, **changes):
    messages = [[k * PERIOD, packed(first + k)] for k in range(round(seconds / PERIOD))]
    return {**WRENCH, "messages": messages, **changes}


@pytest.fixture
def port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def publish(tmp_path, port):
    """Starts a publisher of topics; all that were started are killed in the end."""
    with contextlib.ExitStack() as stack:

        def start(*topics, offset=0.0, domain=3, port=port):
            table = tmp_path / f"table{time.monotonic_ns()}.json"
            table.write_text(json.dumps(topics))
            command = [sys.executable, str(SOURCE), str(port), str(domain), str(table), str(offset)]
            process = stack.enter_context(subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True))
            stack.callback(process.kill)
            assert process.stdout.readline() == "ready\n"
            return process

        yield start


FORCE = {"topic": "/ft/wrench", "field": "wrench.force.z", "unit": "N"}


def device(port, **settings):
    usual = {"signals": {"force": MappedSignal(**FORCE)}, "patience": LONG, "peers": (f"tcp/127.0.0.1:{port}",)}
    return Ros2Device(domain=3, middleware="zenoh", **{**usual, **settings})


def heard(link, enough):
    found, end = [], time.monotonic() + LONG
    for batch in link.batches():
        found.append(batch)
        if sum(len(b.time) for b in found) >= enough:
            break
        assert time.monotonic() < end
    return (np.concatenate([getattr(batch, key) for batch in found]) for key in ("time", "received", "values"))


@pytest.mark.slow
def test_every_message_comes_with_its_number_and_its_time(publish, port):
    publish(wrenches(), offset=-3600.0)
    with device(port).connect(0) as link:
        stamps, received, values = heard(link, 500)
        health = link.health
    assert (np.diff(values[:, 0]) == 1.0).all()
    step = np.diff(stamps)
    assert np.median(np.abs(step - 2e6)) < 2e4
    assert (received >= stamps).all()
    assert np.abs(received - stamps).max() < 60e9  # the hour that the publisher's clock is behind is taken away
    assert health["flags"] == {}
    assert health["topics"]["/ft/wrench"]["missing"] == 0


@pytest.mark.slow
def test_what_humble_writes_in_place_of_hashes_is_read_and_looked_at(publish, port):
    publish(wrenches(hash="TypeHashNotSupported"))
    survey = address_of(f"ros2://3?middleware=zenoh&peer=tcp/127.0.0.1:{port}&for=1.5s").survey()
    (topic,) = survey.topics
    assert (topic.name, topic.type) == ("/ft/wrench", "geometry_msgs/msg/WrenchStamped")
    assert 0 < topic.interval[1] < 10 * PERIOD  # of arrivals: a busy computer hands over several at once


@pytest.mark.slow
def test_a_node_behind_a_router_is_found_by_it(publish, port):
    """As in a laboratory: a router, nodes that know nothing but it, and palpate told where it is."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config):
        publish(wrenches(), port=-port)
        with device(port, peers=(f"127.0.0.1:{port}",)).connect(0) as link:
            _, _, values = heard(link, 500)
    assert (np.diff(values[:, 0]) == 1.0).all()


@pytest.mark.slow
def test_an_alarm_is_latched(publish, port):
    """Who subscribes as rmw_zenoh does to what is latched gets the last of it, however late it comes."""
    publish(wrenches())
    alarm = {"limits": {"force": WatchedRange(greatest="100 N")}, "alarm": "/palpate/alarm"}
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    key = f"3/palpate/alarm/std_msgs::msg::dds_::Bool_/{type_hash('std_msgs/msg/Bool')}"
    said = []
    with device(port, **alarm).connect(0) as link:
        heard(link, 500)
        with zenoh.open(config) as session:
            latest = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            zenoh.ext.declare_advanced_subscriber(
                session, key, lambda sample: said.append(sample.payload.to_bytes()), history=latest
            )
            until = time.monotonic() + LONG
            while not said and time.monotonic() < until:
                time.sleep(0.01)
    assert said[-1] == b"\0\1\0\0\1"  # true
    assert "ros2-limit" in link.health["flags"]


@pytest.mark.slow
def test_nobody_is_told_with_the_router_to_look_for(port):
    with (
        pytest.raises(DeviceError, match=r"no topics at all: is the domain right.* rmw_zenohd"),
        device(port, patience=0.2).connect(0),
    ):
        pass


@pytest.mark.slow
def test_a_peer_that_is_none_is_told_without_zenohs_own_source(port):
    with (
        pytest.raises(DeviceError, match=r"zenoh does not come up: .* foo protocol; peers are \['foo/bar:1'\]$"),
        device(port, peers=("foo/bar:1",)).connect(0),
    ):
        pass


@pytest.mark.slow
def test_a_publisher_that_is_killed_and_comes_back_with_another_type(publish, port):
    first = publish(wrenches())
    with device(port).connect(0) as link:
        batches, found, begin = link.batches(), [], time.monotonic()
        second = third = None
        for batch in batches:
            found.append(batch)
            now = time.monotonic() - begin
            if first.poll() is None and now > 0.5:
                first.kill()
                first.wait()
                second = publish(wrenches(type="geometry_msgs::msg::dds_::AccelStamped_"))
            if third is None and "ros2-unread" in link.health["flags"]:
                second.kill()
                second.wait()
                third = publish(wrenches(first=10**6))
            if len(batch.time) and batch.values[0, 0] >= 10**6:
                break
            assert now < LONG
        flags = link.health["flags"]
    told = "/ft/wrench is published as geometry_msgs/msg/AccelStamped, and read as geometry_msgs/msg/WrenchStamped"
    assert told in flags["ros2-unread"]
    assert "ros2-restarted" in flags


@pytest.mark.slow
def test_hostile_messages_are_left_out_and_counted(publish, port):
    bad = ["", "00", packed(1)[:40], packed(1)[:16] + "ffffffff", "ff" * 200, packed(1) + "00" * (1 << 20)]
    topic = wrenches(3.0)
    for k, raw in enumerate(bad):
        topic["messages"].insert(900 + 50 * k, [(900 + 49 * k) * PERIOD - 5e-4, raw])
    publish({**topic, "stamped": False})
    with device(port, time="log").connect(0) as link:
        _, _, values = heard(link, 1200)
        health = link.health
    steps = np.diff(values[:, 0])
    assert (steps == 1).mean() > 0.99
    assert health["topics"]["/ft/wrench"]["damaged"] >= 4
    assert "ros2-damaged" in health["flags"]


SINK = """
[sink.ros]
type = "ros2"
domain = 5
middleware = "zenoh"
peers = ["tcp/127.0.0.1:{port}"]
"""


@pytest.fixture
def listening(port):
    """A session that is not palpate's, with all that comes to the keys of domain 5, and the tokens in it."""
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    found, tokens = {}, []
    with zenoh.open(config) as session:
        session.liveliness().declare_subscriber("@ros2_lv/5/**", lambda s: tokens.append((s.kind, str(s.key_expr))))
        session.declare_subscriber("5/**", lambda s: found.setdefault(str(s.key_expr), []).append(s))
        yield found, tokens


@pytest.mark.slow
def test_what_is_found_is_published_where_rmw_zenoh_looks(listening, port, tmp_path):
    found, tokens = listening
    file = tmp_path / "simulated.toml"
    simulated = playing.SPECIMEN.format(seconds=6) + playing.MODEL + SINK.format(port=port)
    file.write_text(simulated)
    result = run_pipeline(load_pipeline(file), tmp_path / "run")
    key = (
        "5/palpate/dr/kinematic/elasticity/geometry_msgs::msg::dds_::Vector3Stamped_/"
        "RIHS01_d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a"
    )
    samples = found[key]
    assert len(samples) > 200
    assert len(found[key.rpartition("/")[0] + "/TypeHashNotSupported"]) == len(samples)  # for Humble
    last = struct.unpack("<3d", samples[-1].payload.to_bytes()[-24:])
    value = result.tracks["dr/kinematic"].table()["parameters"]["elasticity"]["value"]
    assert last[0] == pytest.approx(value, rel=0.05)
    numbers = [struct.unpack("<q", sample.attachment.to_bytes()[:8])[0] for sample in samples]
    assert numbers == list(range(1, len(samples) + 1))
    publishers = {token.split("/")[9] for kind, token in tokens if kind == zenoh.SampleKind.PUT and "/MP/" in token}
    assert {"%palpate%flags", "%palpate%dr%kinematic%elasticity"} <= publishers


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"middleware": "zenoh", "interface": "eth0"}, "interface is of DDS"),
        ({"peers": ["tcp/10.0.0.1:7447"]}, "without a protocol"),
        ({"middleware": "zeno"}, "'dds' or 'zenoh'"),
    ],
)
@pytest.mark.parametrize("kind", [Ros2Device, Ros2Sink])
def test_addresses_of_the_other_middleware_are_told(settings, problem, kind):
    more = {"signals": {"force": FORCE}} if kind is Ros2Device else {}
    with pytest.raises(ValidationError, match=problem):
        kind.model_validate_json(json.dumps({**more, **settings}))


@pytest.mark.parametrize(
    ("text", "network"),
    [
        ("ros2://1?middleware=zenoh", Network(1, middleware="zenoh")),
        ("ros2://0?middleware=zenoh&peer=tcp/a:1", Network(0, None, ("tcp/a:1",), middleware="zenoh")),
    ],
)
def test_addresses(text, network):
    assert address_of(text).network == network


@pytest.mark.parametrize("text", ["ros2://0?middleware=dcps", "ros2://0?middleware=zenoh&interface=lo"])
def test_wrong_addresses_are_told(text):
    with pytest.raises(ConfigurationError, match=r"ros2:"):
        address_of(text)
