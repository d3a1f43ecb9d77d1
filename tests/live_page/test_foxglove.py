"""Foxglove's end: who gets in, what there is to subscribe to, and that nothing else can be asked for."""

import json
import struct
from contextlib import contextmanager

import numpy as np
import pytest
from palpate import Flag, GuardState
from palpate_live.foxglove import SUBPROTOCOLS
from palpate_live.live_feed import PageFeed
from palpate_live.server_process import PageServer
from palpate_live.sink import _FOXGLOVE
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.live_page.conftest import TRACKS
from tests.live_page.test_feed import FOUND


@pytest.fixture
def child():
    made = PageServer(0, None, served=_FOXGLOVE)
    yield made
    assert made.close() is None


@contextmanager
def viewer(child, path=None, **more):
    """A program that connects as Foxglove does."""
    address = f"ws://127.0.0.1:{child.port}/{child.token if path is None else path}"
    with connect(address, **{"subprotocols": SUBPROTOCOLS[1:], "max_size": None, "open_timeout": 60, **more}) as found:
        yield found


def json_of(socket, op):
    """The next message that is text, which has to be of a kind."""
    while not isinstance(said := socket.recv(timeout=20), str):
        pass
    found = json.loads(said)
    assert found["op"] == op, found
    return found


def data_of(socket, subscription):
    """Time [ns] and contents of the next message of a subscription."""
    while True:
        said = socket.recv(timeout=20)
        if isinstance(said, bytes):
            opcode, number, time = struct.unpack_from("<BIQ", said)
            assert opcode == 1
            if number == subscription:
                return time, json.loads(said[13:])


def subscribe(socket, channels, *topics):
    wishes = [{"id": 100 + channels[topic], "channelId": channels[topic]} for topic in topics]
    socket.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
    return [wish["id"] for wish in wishes]


def greeted(socket):
    """The channels by topic, and their schemas."""
    hello = json_of(socket, "serverInfo")
    assert hello["capabilities"] == []  # no services, no parameters, nothing to publish
    offered = json_of(socket, "advertise")["channels"]
    while not offered:
        offered = json_of(socket, "advertise")["channels"]
    schemas = {channel["topic"]: json.loads(channel["schema"])["properties"] for channel in offered}
    assert {channel["encoding"] for channel in offered} == {"json"}
    assert len({channel["id"] for channel in offered}) == len(offered)
    return {channel["topic"]: channel["id"] for channel in offered}, schemas


@pytest.mark.slow
def test_a_viewer_gets_what_it_subscribes_to(child, a_run, samples, estimates):
    feed = PageFeed(a_run(), child.send, {})
    with viewer(child, origin="https://app.foxglove.dev") as socket:
        channels, schemas = greeted(socket)
        assert {f"/palpate/estimates/{track}" for track in TRACKS} < set(channels)
        assert {"elasticity", "elasticity_combined", "surface", "nis"} < set(schemas["/palpate/estimates/dr/a"])
        force, track = subscribe(socket, channels, "/palpate/samples", "/palpate/estimates/dr/a")
        subscribe(socket, channels, "/palpate/health")
        feed.health({"time": 0.0, "tracks": {}})
        data_of(socket, 100 + channels["/palpate/health"])  # now the subscriptions are known
        block = samples(500, 500)
        feed.samples(block)
        feed.estimates("dr/a", estimates(block, 2))
        feed.flush()
        rows = [data_of(socket, force) for _ in range(100)]
        assert [row["time"] for _, row in rows] == pytest.approx(list(1.0 + np.arange(100) / 100), abs=0.0021)
        assert all(row["force"] == round(500 * row["time"]) for _, row in rows)
        assert all(abs(when - 1e9 * row["time"]) < 1e3 for when, row in rows)  # ns of the record's clock
        assert "x" not in rows[0][1]  # what is not known is left out: JSON has no NaN
        found = data_of(socket, track)[1]
        assert found["elasticity"] == pytest.approx(found["time"])
        assert found["elasticity_combined"] == pytest.approx(1e-3)


@pytest.mark.slow
def test_one_who_comes_late_gets_how_things_stand(child, a_run):
    feed = PageFeed(a_run(), child.send, {})
    feed.health({"time": 1.0, "tracks": {"dr/a": {"parameters": {"elasticity": FOUND}}}})
    feed.guard(GuardState("motion"))
    feed.flags(None, (Flag("gaps", "arm has 3 gaps", "note"), Flag("untared", "the force is not 0", "doubtful")))
    feed.flags(None, (Flag("gaps", "arm has 4 gaps", "note"),))
    with viewer(child) as socket:
        channels, schemas = greeted(socket)
        guard, found, flags = subscribe(socket, channels, "/palpate/guard", "/palpate/found", "/palpate/flags")
        assert data_of(socket, guard)[1]["phase"] == "motion"
        assert data_of(socket, found)[1]["parameters"]["elasticity"][:2] == [2.0, 5.0]
        logs = sorted((data_of(socket, flags)[1] for _ in range(2)), key=lambda log: log["level"])
        assert [(log["level"], log["message"]) for log in logs] == [
            (2, "gaps: arm has 3 gaps"),
            (3, "untared: the force is not 0"),
        ]
        assert set(logs[0]) == set(schemas["/palpate/flags"])
        assert logs[0]["name"] == "every track"
        feed.guard(GuardState("over"))
        assert data_of(socket, guard)[1]["phase"] == "over"
        socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [guard]}))
        feed.flags(None, ())
        feed.flags(None, (Flag("gaps", "again", "note"),))
        assert data_of(socket, flags)[1]["message"] == "gaps: again"  # it had fallen, and rises once more


JUNK = [
    "stop",
    "[]",
    "{}",
    '{"op": "stop"}',
    '{"op": "advertise", "channels": []}',
    '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',
    '{"op": "subscribe", "subscriptions": [{"id": -5000000000, "channelId": 1}]}',
    '{"op": "subscribe", "subscriptions": [{"id": "a", "channelId": 1}]}',
    '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": [1]}]}',
    '{"op": "unsubscribe", "subscriptionIds": [[1]]}',
    b"\x01\x00\x00\x00\x00stop",
    "[" * 60_000,
]


@pytest.mark.slow
def test_nothing_else_can_be_asked_for(child, a_run):
    PageFeed(a_run(), child.send, {})
    with viewer(child) as socket:
        greeted(socket)
        for said in JUNK:
            socket.send(said)
            assert json_of(socket, "status")["level"] == 2, said
    assert child.lost is None


def test_strangers_are_refused(child):
    """The address holds a token; a page anywhere may connect, if a person has given it the address."""
    for path, more in [
        ("", {}),
        ("wrong", {}),
        (None, {"additional_headers": {"Host": "127.0.0.1.evil.example"}}),
    ]:
        with pytest.raises(InvalidStatus) as refused, viewer(child, path, **more):
            pass
        assert refused.value.response.status_code == 403
    with pytest.raises(InvalidStatus), viewer(child, subprotocols=["another"]):
        pass


@pytest.mark.slow
def test_a_run_with_it_finds_the_same(run_point, monkeypatch):
    said = []
    monkeypatch.setattr("palpate_live.sink.say", said.append)
    short = "trajectory.press.duration=1 s"
    plain, shown = run_point(short, name="plain"), run_point(short, 'sink.fox.type="foxglove"', name="shown")
    assert (plain.folder / "estimates.csv").read_bytes() == (shown.folder / "estimates.csv").read_bytes()
    assert len(said) == 1
    assert said[0].startswith("Foxglove server: ws://127.0.0.1:")
