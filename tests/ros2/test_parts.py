"""What needs no network: names, packed messages, clocks, losses, publishers, limits, addresses."""

import json

import numpy as np
import pytest
from palpate import Batch, Estimates, Flag, Parameter, Run, Samples
from palpate.errors import ConfigurationError
from palpate_ros2.device import Ros2Device
from palpate_ros2.domain_survey import address_of
from palpate_ros2.limits import Limit, LimitBounds
from palpate_ros2.message_pipe import Inlet, Outlet, ReceivedMessage, message_pipe
from palpate_ros2.messages import boolean, cloud, diagnostics, legal_name, pack_vector_stamped
from palpate_ros2.network import Network
from palpate_ros2.publisher_statistics import CommonClock, Losses, Publisher, StampClock
from palpate_ros2.sink import Ros2Sink, RunPublisher
from pydantic import ValidationError

MS = 1_000_000  # [ns]


def test_a_vector_says_its_numbers_time_and_frame(decoded):
    message = decoded(*pack_vector_stamped(12_000_000_345, "skin", (112.5e3, 1.5, 0.25)))
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (12, 345, "skin")
    assert (message.vector.x, message.vector.y, message.vector.z) == (112.5e3, 1.5, 0.25)


def test_a_map_is_a_cloud_whose_fields_tell_where_their_numbers_are(decoded):
    points = np.arange(12.0).reshape(3, 4)
    message = decoded(*cloud(0, "skin", ["x", "y", "z", "elasticity"], points))
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 3, 16, 48)
    table = np.frombuffer(bytes(message.data), "<f4").reshape(3, 4)
    assert (table == points).all()
    assert [(field.name, field.offset, field.datatype) for field in message.fields][3] == ("elasticity", 12, 7)
    assert message.is_dense


def test_flags_are_diagnostics_by_severity(decoded):
    flags = {
        "dr/ekf": (Flag("no-contact", "nowhere", "invalid"), Flag("gaps", "two", "note")),
        "dr/fit": (),
    }
    message = decoded(*diagnostics(0, flags))
    levels = {entry.name: entry.level for entry in message.status}
    assert levels == {"palpate: dr/fit": 0, "palpate: dr/ekf: no-contact": 2, "palpate: dr/ekf: gaps": 1}
    assert decoded(*boolean(True)).data is True


@pytest.mark.parametrize(
    ("name", "legal"),
    [("dr", "dr"), ("casadi-fit", "casadi_fit"), ("2nd try", "n2nd_try"), ("a__b", "a_b"), ("-", "n")],
)
def test_names_are_legal_in_topics(name, legal):
    assert legal_name(name) == legal


def test_frames_cross_the_pipe_whole_however_they_are_cut():
    reading, writing = message_pipe()
    outlet, inlet = Outlet(writing), Inlet(reading)
    sent = [
        ReceivedMessage(k % 3, 100 + k, 200 + k, 7, bytes(k * 997 % 70_000)) for k in range(150)
    ]  # more than fits at once
    got = []
    for message in sent:
        outlet.put(message)
    while len(got) < len(sent):
        outlet.flush()
        got += inlet.messages()
    assert got == sent
    assert outlet.lost == 0


def test_a_clock_is_mapped_by_its_fastest_message_and_anew_when_it_leaps():
    clock = StampClock()
    stamps = np.arange(1000) * 2 * MS
    late = np.random.default_rng(1).exponential(0.3 * MS, 1000).astype(int) + 100_000
    mapped = clock.to_host(stamps, stamps + 5_000_000_000 + late)
    assert np.abs(mapped[100:] - (stamps[100:] + 5_000_000_000 + 100_000)).max() < 0.1 * MS
    again = clock.to_host(stamps, stamps + 9_000_000_000 + late)  # the same stamps once more, four seconds later
    assert clock.restarts == 1
    assert np.abs(again[100:] - (stamps[100:] + 9_000_000_000 + 100_000)).max() < 0.1 * MS
    ahead = clock.to_host(stamps[-1:] + 3_600_000_000_000, np.array([11_100_000_000]))
    assert clock.restarts == 2
    assert ahead[0] == 11_100_000_000


def test_topics_of_one_clock_keep_what_lies_between_them():
    """One topic is always 3 ms late; mapped by itself it would seem to be on time."""
    clock, apart = CommonClock(), 5_000_000_000
    stamps = np.arange(1000) * 2 * MS
    fast, slow = [], []
    for k in range(0, 1000, 10):
        rows = stamps[k : k + 10]
        fast.append(clock.to_host("/fast", rows, rows + apart + MS // 10))
        slow.append(clock.to_host("/slow", rows, rows + apart + 3 * MS))
    assert np.abs(np.concatenate(fast) - np.concatenate(slow))[100:].max() < 1000  # [ns]
    assert clock.delay_range == ("/fast", "/slow", pytest.approx(2.9e-3))
    clock.to_host("/fast", stamps[:1], np.array([apart * 9]))
    assert clock.restarts == 1


def test_a_stall_of_the_network_is_no_leap():
    clock = StampClock()
    stamps = np.arange(1000) * 2 * MS
    received = np.maximum(stamps + MS, np.where(stamps > 1000 * MS, 1800 * MS, 0))  # nothing for 0.8 s, then all
    clock.to_host(stamps, received)
    assert clock.restarts == 0


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize(
    ("drop", "missing", "pauses"),
    [([], 0, 0), ([400], 1, 0), ([100, 101, 102, 500], 4, 0), (range(200, 900), 0, 1)],
)
def test_losses_are_counted_from_stamps(cut, drop, missing, pauses):
    stamps = np.delete(np.arange(1200) * 2 * MS, list(drop))
    losses = Losses()
    for begin in range(0, len(stamps), cut):
        losses.add(stamps[begin : begin + cut])
    assert (losses.missing, losses.pauses) == (missing, pauses)
    assert losses.rate == pytest.approx(500.0)


def test_a_publisher_that_was_held_up_and_catches_up_has_lost_nothing():
    stamps = np.arange(1000) * 2 * MS
    stamps[300:320] = stamps[320] - np.arange(20, 0, -1) * 10_000
    losses = Losses()
    losses.add(stamps)
    assert losses.missing == 0


@pytest.mark.parametrize("late", [1, 3, 40, 100])
@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize("lost", [0, 2])
def test_what_comes_behind_its_successors_is_no_loss(late, cut, lost):
    """By as many messages as the usual step is known from, or more."""
    stamps = np.arange(1000) * 2 * MS
    for i in (300, 600, 601):
        stamps[i : i + late + 1] = np.roll(stamps[i : i + late + 1], -1)
    stamps = np.delete(stamps, range(200, 200 + lost))
    losses = Losses()
    for begin in range(0, len(stamps), cut):
        losses.add(stamps[begin : begin + cut])
    assert losses.missing == lost
    assert losses.rate == pytest.approx(500.0)


def test_a_clock_that_is_set_back_has_lost_nothing():
    stamps = np.arange(1000) * 2 * MS
    stamps[500:] -= 5_000 * MS
    losses = Losses()
    losses.add(stamps)
    assert (losses.missing, losses.pauses) == (0, 0)


def test_the_first_of_two_publishers_is_read_until_it_falls_silent():
    publisher = Publisher()
    assert [publisher.accepts(w, k * MS) for k, w in enumerate([1, 1, 2, 1, 2])] == [True, True, False, True, False]
    assert not publisher.accepts(2, 400 * MS)
    assert publisher.accepts(2, 600 * MS)
    assert (publisher.changes, publisher.ignored) == (1, 3)
    publisher.note_departure(2)
    assert publisher.accepts(3, 601 * MS)


def test_publishers_of_parts_are_all_read():
    assert all(Publisher(accepts_all=True).accepts(writer, writer) for writer in (1, 2, 3))


def test_a_reading_beyond_a_limit_is_counted_with_the_farthest():
    limit = Limit(LimitBounds("force", "wrench", 0, "N", -1.0, 20.0))
    values = np.array([[0.0], [25.0], [np.nan], [30.0], [-3.0]])
    stamps = np.arange(5)
    assert not limit.check(Batch("pose", stamps, stamps, values))
    assert limit.check(Batch("wrench", stamps, stamps, values))
    assert not limit.check(Batch("wrench", stamps, stamps, np.full((5, 1), np.nan)))
    assert str(limit) == "3 readings of force are beyond its limit of 20 N, the farthest at 30 N"


@pytest.mark.parametrize(
    ("text", "network", "seconds"),
    [
        ("ros2://7", Network(7), 3.0),
        ("ros2:/7", Network(7), 3.0),
        ("ros2://", Network(0), 3.0),
        ("ros2://0?interface=lo&peer=10.0.0.2&peer=10.0.0.3&for=5s", Network(0, "lo", ("10.0.0.2", "10.0.0.3")), 5.0),
        ("ros2://0?for=2.5", Network(0), 2.5),
    ],
)
def test_addresses(text, network, seconds):
    address = address_of(text)
    assert (address.network, address.seconds) == (network, seconds)


def test_a_file_is_no_address():
    assert address_of("runs/ros2.mcap") is None


@pytest.mark.parametrize("text", ["ros2://233", "ros2://x", "ros2://0?port=3", "ros2://0?for=1m/s", "ros2://0?for=0"])
def test_wrong_addresses_are_told(text):
    with pytest.raises(ConfigurationError, match="ros2:"):
        address_of(text)


FORCE = {"topic": "/wrench", "field": "wrench.force.z", "unit": "N"}


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({}, "give signals"),
        ({"signals": {"force": FORCE}, "limits": {"farce": {"greatest": 1.0}}}, "no channel 'farce'"),
        ({"signals": {"force": FORCE}, "limits": {"force": {"greatest": "3 mm"}}}, "is a length, not a force"),
        ({"signals": {"force": FORCE}, "limits": {"force": {"least": 2.0, "greatest": 1.0}}}, "is not below"),
        ({"signals": {"force": FORCE}, "alarm": "/alarm"}, "alarm needs limits"),
        ({"signals": {"force": FORCE}, "types": {"Load": "float64 x"}}, "is not a type"),
        ({"signals": {"force": FORCE}, "types": {"a/msg/Load": "float65 x"}}, "a/float65"),
        ({"signals": {"force": FORCE}, "domain": 233}, "232"),
    ],
)
def test_mistakes_are_told_before_anything_is_connected(settings, problem):
    with pytest.raises(ValidationError, match=problem):
        Ros2Device.model_validate_json(json.dumps(settings))


def test_topics_without_a_slash_are_in_the_namespace():
    signals = {"force": {**FORCE, "topic": "ft/wrench"}, "z": {**FORCE, "topic": "/wrench"}}
    device = Ros2Device.model_validate_json(json.dumps({"signals": signals, "namespace": "/left"}))
    assert device._topics == ["/left/ft/wrench", "/wrench"]


class Kept:
    """Keeps what would be sent."""

    def __init__(self):
        self.sent = []

    def announce(self, topic, type_name, latched=False):
        pass

    def send(self, topic, type_name, payload, latched=False):
        self.sent.append((topic, type_name, payload))


@pytest.mark.parametrize("cut", [50, 1000])
def test_a_sweep_becomes_a_map_of_places_however_it_is_cut(decoded, tmp_path, cut):
    parameter = Parameter("elasticity", "E", "Pa", "stiffness")
    kept, time = Kept(), np.arange(1000) * 0.002
    writer = RunPublisher(Ros2Sink(), Run(tmp_path, {}, {"dr/kinematic-ekf": (parameter,)}, {}, {}), kept)
    n, along = len(time), 5e-3 * time  # 10 mm
    for rows in (slice(i, i + cut) for i in range(0, n, cut)):
        t, x = time[rows], along[rows]
        ones = np.ones(len(t))
        lateral = np.column_stack([x, 0 * x])
        on = ones.astype(bool)
        writer.samples(Samples((t * 1e9).astype(np.int64), t, ones, ones, ones, ones, on, on, lateral))
        values = (1e5 + 1e7 * x)[:, None]
        status = np.zeros(len(t), np.uint32)
        writer.estimates("dr/kinematic-ekf", Estimates(t, values, 0 * values + 10, -x, ones, ones, ones, status))
    writer.result({"tracks": {}})
    base = "/palpate/dr/kinematic_ekf"
    vectors = [payload for topic, _, payload in kept.sent if topic == f"{base}/elasticity"]
    assert len(vectors) == 100  # 2 s, one in 20 ms
    _, name, payload = next(entry for entry in reversed(kept.sent) if entry[0] == f"{base}/map")
    message = decoded(name, payload)
    assert [field.name for field in message.fields] == ["x", "y", "z", "elasticity", "elasticity_std"]
    x, y, z, elasticity, std = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 5).T.astype(float)
    assert len(x) == pytest.approx(50, abs=2)  # 0.2 mm apart
    assert np.abs(elasticity - 1e5 - 1e7 * x).max() < 1e7 * 2.1e-4  # the latest within a place
    assert (y == 0).all()
    assert (std == 10).all()
    assert np.abs(z + x).max() < 2.1e-4
