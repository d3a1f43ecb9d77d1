"""Encodings that are seldom: read as other readers do, or refused in words; never wrong."""

import json
import struct

import numpy as np
import pytest
from mcap.writer import Writer
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import WRENCH
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Messages, Topic

from tests.records.bags import Cdr, wrench_message

NUMBERS = [1.5, -2.0, 3.25, 0.0, 1e-300, 7.0]
FORCE = {"force": {"topic": "/odd", "field": "wrench.force.z", "unit": "N"}}
PATHS = [f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"]
NAMED = "float64 before\nwstring words\nfloat64 after\n"


def table(topic, payloads, readings):
    none = np.zeros(len(payloads), np.int64)
    return decoder_of(topic).read(Messages.joined(payloads, none, none), readings)


def log_of(path, encoding, schema, payloads, plain=()):
    """An MCAP log of one topic of an odd encoding, and of plain wrenches."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        odd = writer.register_channel("/odd", encoding, writer.register_schema(*schema))
        kind = writer.register_schema(WRENCH.name, "ros2msg", WRENCH.definition.encode())
        usual = writer.register_channel("/usual", "cdr", kind)
        for i, payload in enumerate(payloads):
            writer.add_message(odd, i, payload, i)
        for i, payload in enumerate(plain):
            writer.add_message(usual, i, payload, i)
        writer.finish()
    return path


def read(path, signals=FORCE):
    with McapReplay.model_validate({"file": path, "signals": signals}).connect(0) as link:
        return np.concatenate([batch.values[:, 0] for batch in link.batches()])


@pytest.mark.parametrize("kind", [0, 1, 2, 3])
def test_every_kind_of_plain_cdr_reads_as_another_reader_reads_it(kind):
    """Some writers call a plain message a parameter list."""
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    message = Cdr(big=kind % 2 == 0).header(5 * 10**9 + 7, "ft_sensor0_wrench").put("d", *NUMBERS)
    message.data[1] = kind
    payload = bytes(message)
    decode = DecoderFactory().decoder_for("cdr", Schema(1, WRENCH.definition.encode(), "ros2msg", WRENCH.name))
    theirs = decode(payload)
    found = table(Topic("/odd", WRENCH.name), [payload] * 3, [FieldReading(path) for path in PATHS])
    expected = [getattr(getattr(theirs.wrench, part), axis) for part in ("force", "torque") for axis in "xyz"]
    np.testing.assert_array_equal(found.values, [expected] * 3)
    assert found.stamps.tolist() == [5 * 10**9 + 7] * 3


def test_kinds_that_change_within_a_topic():
    payloads = [bytes(Cdr(big=big).header(i, "f").put("d", *NUMBERS)) for i, big in enumerate([0, 1, 0, 0, 1])]
    found = table(Topic("/odd", WRENCH.name), payloads, [FieldReading("wrench.force.z")])
    assert found.values[:, 0].tolist() == [3.25] * 5
    assert found.stamps.tolist() == list(range(5))


@pytest.mark.parametrize("kind", [2, 3])
@pytest.mark.parametrize("fields", [1, 2, 6])
def test_a_real_parameter_list_is_refused(kind, fields):
    """Each member has a head of its own, and a sentinel ends them: its bytes are no message of the type."""
    order = "<" if kind == 3 else ">"
    body = b""
    for i in range(fields):
        body += struct.pack(f"{order}HHd", i, 8, float(i + 1))
    payload = bytes([0, kind, 0, 0]) + body + struct.pack(f"{order}HH", 1, 0)
    definition = "".join(f"float64 n{i}\n" for i in range(fields))
    with pytest.raises(LogError, match=r"parameter list|belong to no field"):
        table(Topic("/odd", "lab/msg/Numbers", schema=definition.encode()), [payload], [FieldReading("n0")])


@pytest.mark.parametrize("kind", [4, 6, 7, 9, 11, 255])
def test_kinds_of_cdr_that_are_not_read_are_named(kind):
    payload = bytes([0, kind, 0, 0]) + bytes(Cdr().header(0, "f").put("d", *NUMBERS))[4:]
    with pytest.raises(LogError, match=f"in CDR of the kind {kind}, which is not read"):
        table(Topic("/odd", WRENCH.name), [payload], [FieldReading("wrench.force.z")])


def wide_message(width, words, before=1.5, after=2.5):
    message = Cdr().put("d", before).put("I", len(words))
    message.put("I" if width == 4 else "H", *map(ord, words))
    return bytes(message.put("d", after))


@pytest.mark.parametrize("width", [2, 4])
@pytest.mark.parametrize("words", ["", "a", "ab", "elastic", "Prüfkörper"])
def test_numbers_beside_wide_strings(width, words):
    topic = Topic("/odd", "lab/msg/Named", schema=NAMED.encode())
    payloads = [wide_message(width, words, i, -i) for i in range(4)] + [wide_message(width, "another", 9.0, -9.0)]
    found = table(topic, payloads, [FieldReading("before"), FieldReading("after")])
    np.testing.assert_array_equal(found.values, [[0, 0], [1, -1], [2, -2], [3, -3], [9, -9]])


def test_wide_strings_that_could_be_either_are_refused():
    """Two characters of 4 bytes and an empty sequence, or of 2 bytes and a sequence of four zeros."""
    payload = bytes(Cdr().put("I", 2).put("H", ord("a"), ord("b")).put("I", 4, 0))
    topic = Topic("/odd", "lab/msg/Named", schema=b"wstring words\nuint8[] rest\n")
    with pytest.raises(LogError, match="could be of 2 or of 4 bytes a character"):
        table(topic, [payload], [FieldReading("rest", 0)])


ROS1 = (
    "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n"
    "================================================================================\n"
    "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    "================================================================================\n"
    "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"
    "================================================================================\n"
    "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
)


def ros1_message(i):
    return struct.pack("<IIII", i, 3, 50 + i, 5) + b"tool0" + struct.pack("<6d", i, -i, i / 8, 0, 0, 1)


def ros1_log(path, text, payloads):
    return log_of(path, "ros1", ("geometry_msgs/WrenchStamped", "ros1msg", text.encode()), payloads)


def test_ros_1(tmp_path):
    path = ros1_log(tmp_path / "log.mcap", ROS1, [ros1_message(i) for i in range(20)])
    device = McapReplay.model_validate({"file": path, "signals": FORCE})
    with device.connect(0) as link:
        batches = list(link.batches())
    assert np.concatenate([b.values[:, 0] for b in batches]).tolist() == [i / 8 for i in range(20)]
    assert np.concatenate([b.time for b in batches]).tolist() == [3 * 10**9 + 50 + i for i in range(20)]
    (topic,) = [topic for topic in McapReplay.survey(path).topics if topic.name == "/odd"]
    assert "wrench.force.z" in topic.fields


def test_ros_1_does_not_take_the_header_of_ros_2(tmp_path):
    path = ros1_log(tmp_path / "log.mcap", ROS1.partition("====")[0], [ros1_message(0)])
    with pytest.raises(LogError, match="names std_msgs/Header, which the log does not define"):
        read(path)


@pytest.mark.parametrize(
    ("cut", "words"), [(slice(-1), "it ends before its fields do"), (slice(None), "1 bytes of it belong to no field")]
)
def test_a_message_of_ros_1_that_is_damaged(tmp_path, cut, words):
    path = ros1_log(tmp_path / "log.mcap", ROS1, [(ros1_message(0) + b"\0"[: cut == slice(None)])[cut]])
    with pytest.raises(LogError, match=words):
        read(path)


@pytest.mark.parametrize("encoding", ["cbor", "flatbuffer", "x-lab"])
def test_what_nobody_reads_is_refused_when_it_is_mapped_only(tmp_path, encoding):
    plain = [wrench_message(i, "f", NUMBERS) for i in range(5)]
    path = log_of(tmp_path / "log.mcap", encoding, ("Lab", "lab", b"?"), [b"\xff\x01"] * 3, plain)
    usual = {"force": {**FORCE["force"], "topic": "/usual"}}
    assert read(path, usual).tolist() == [3.25] * 5
    with pytest.raises(LogError, match=rf"topic /odd: its messages cannot be read \({encoding}, described in lab"):
        read(path)


def test_a_standard_type_that_is_described_in_idl(tmp_path):
    schema = ("geometry_msgs/msg/WrenchStamped", "ros2idl", b"module geometry_msgs { struct WrenchStamped {}; };")
    path = log_of(tmp_path / "log.mcap", "cdr", schema, [wrench_message(i, "f", NUMBERS) for i in range(5)])
    assert read(path).tolist() == [3.25] * 5


def test_joints_and_transforms_in_json(tmp_path):
    def joints(i):
        names = ["hip", "toe"] if i % 2 else ["toe", "hip"]
        return json.dumps({"name": names, "position": [i, -i] if i % 2 else [-i, i]}).encode()

    path = log_of(tmp_path / "log.mcap", "json", ("Joints", "jsonschema", b"{}"), [joints(i) for i in range(6)])
    signals = {"toe": {"topic": "/odd", "field": "position", "select": "toe", "unit": "rad"}}
    assert read(path, signals).tolist() == [-i for i in range(6)]
    frame = {"header": {"stamp": {"sec": 1, "nanosec": 2}}, "child_frame_id": "tool0"}
    frames = [
        json.dumps(
            {"transforms": [{"child_frame_id": "other", "transform": {"z": 9.0}}, {**frame, "transform": {"z": i}}]}
        )
        for i in range(3)
    ]
    path = log_of(tmp_path / "tf.mcap", "json", ("TF", "jsonschema", b"{}"), [text.encode() for text in frames])
    signals = {"z": {"topic": "/odd", "field": "transforms.transform.z", "select": "tool0", "unit": "m"}}
    device = McapReplay.model_validate({"file": path, "signals": signals, "time": "log"})
    with device.connect(0) as link:
        assert np.concatenate([batch.values[:, 0] for batch in link.batches()]).tolist() == [0, 1, 2]
