"""Valid files that are seldom, by the official writers: what the official readers find in them."""

import itertools
import math
import struct

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap_ros2.writer import Writer as Ros2Writer

from tests.records.official import STYLES, assert_agreement, json_topic, log_of, ours, ros_topic

mcap_protobuf = pytest.importorskip("mcap_protobuf.writer")
ROSBAGS = pytest.importorskip("rosbags.rosbag2")


@pytest.mark.parametrize("style", STYLES)
def test_ways_to_write_a_log(tmp_path, style):
    def build(writer):
        json_topic(writer, "/json", [{"x": i, "y": -i / 3} for i in range(40)])
        ros_topic(writer, "/ros", "lab/msg/A", "float64 x\nint32 n", [struct.pack("<di", i / 7, -i) for i in range(40)])
        writer.register_channel("/silent", "json", 0)

    path = log_of(tmp_path / "log.mcap", build, **STYLES[style])
    assert assert_agreement(path) == 160


JSON = {
    "digits": [{"x": 10**308 + i, "y": 10**309, "z": -(10**309), "n": 2**53} for i in range(3)],
    "kinds": [{"a": True, "b": None, "c": "words", "d": 1e-300, "e": [], "f": {}, "g": -0.0} for _ in range(3)],
    "names": [{"a.b": 1, "c[0]": 2, "1": 3, "größe": 4, "[": 5, "a": {"b.c": 6, "7": 7}} for _ in range(3)],
    "depth": [{"a": [{"b": [[i, 2], [3, 4]]}, {"b": [[5, 6]]}]} for i in range(3)],
    "long array": [{"x": list(range(i, i + 300))} for i in range(3)],
    "many objects": [{"points": [{"x": i, "y": k} for k in range(100)]} for i in range(3)],
    "number": [1, 2.5, 3],
    "array": [[i, i + 1, i + 2] for i in range(3)],
    "fields that come and go": [{"x": 1, "y": 2}, {"y": 3}, {"x": 4, "y": "no number"}, {"x": [5], "y": 6}],
    "not finite": [{"x": math.nan, "y": math.inf, "z": 1.0}],
}


@pytest.mark.parametrize("case", JSON)
def test_json(tmp_path, case):
    path = log_of(tmp_path / "log.mcap", lambda writer: json_topic(writer, "/j", JSON[case]))
    assert assert_agreement(path) > 0


def file_of(name, package, *imports, syntax="proto3"):
    return descriptor_pb2.FileDescriptorProto(name=name, package=package, syntax=syntax, dependency=imports)


def add(message, name, number, kind, label=1, type_name=None):
    message.field.add(name=name, number=number, type=kind, label=label, type_name=type_name)


def protobuf_files():
    """Descriptors in the order of their imports: numbers, times and the reading that has both."""
    base = file_of("lab/base.proto", "lab.base")
    point = base.message_type.add(name="Point")
    for number, axis in enumerate("xyz", 1):
        add(point, axis, number, 1)
    middle = file_of("lab/middle.proto", "lab", "lab/base.proto")
    pair = middle.message_type.add(name="Pair")
    add(pair, "a", 1, 11, type_name=".lab.base.Point")
    add(pair, "b", 2, 11, type_name=".lab.base.Point")
    top = file_of("lab/top.proto", "lab", "lab/middle.proto", "lab/base.proto")
    state = top.enum_type.add(name="State")
    for number, name in enumerate(("AIR", "CONTACT")):
        state.value.add(name=name, number=number)
    reading = top.message_type.add(name="Reading")
    add(reading, "pair", 1, 11, type_name=".lab.Pair")
    add(reading, "points", 2, 11, 3, ".lab.base.Point")
    add(reading, "state", 3, 14, type_name=".lab.State")
    for number, kind in enumerate((1, 2, 3, 4, 5, 6, 7, 8, 13, 15, 16, 17, 18), 4):  # every number that there is
        add(reading, f"n{kind}", number, kind)
    add(reading, "many", 30, 17, 3)
    add(reading, "raw", 31, 12)
    add(reading, "words", 32, 9)
    inner = reading.nested_type.add(name="ByNameEntry")
    inner.options.map_entry = True
    add(inner, "key", 1, 9)
    add(inner, "value", 2, 1)
    add(reading, "by_name", 33, 11, 3, ".lab.Reading.ByNameEntry")
    return [base, middle, top]


def reading_class(files):
    pool = descriptor_pool.DescriptorPool()
    for file in files:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("lab.Reading"))


def readings(kind):
    for i in range(5):
        message = kind(many=[-i, 2**31 - 1], raw=bytes([i, 255]), words="x", state=i % 2, by_name={"k": i / 3, "7": -i})
        message.pair.a.x, message.pair.b.z = i / 7, -1e300
        message.points.add(x=i)
        message.n3, message.n4, message.n5, message.n8 = -(2**63) + 2048 * i, 2**64 - 2048, -i, True
        yield message


def test_protobuf_by_its_own_writer(tmp_path):
    path = tmp_path / "log.mcap"
    with mcap_protobuf.Writer(str(path)) as writer:
        for i, message in enumerate(readings(reading_class(protobuf_files()))):
            writer.write_message("/p", message, i, i)
    assert assert_agreement(path) == 5 * 29


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_descriptors_of_protobuf_in_any_order(tmp_path, order):
    files = protobuf_files()
    schema = descriptor_pb2.FileDescriptorSet(file=[files[i] for i in order]).SerializeToString()

    def build(writer):
        channel = writer.register_channel("/p", "protobuf", writer.register_schema("lab.Reading", "protobuf", schema))
        for i, message in enumerate(readings(reading_class(files))):
            writer.add_message(channel, i, message.SerializeToString(), i)

    assert assert_agreement(log_of(tmp_path / "log.mcap", build)) == 5 * 29


def test_an_empty_message_of_protobuf_is_one_of_zeros(tmp_path):
    schema = descriptor_pb2.FileDescriptorSet(file=protobuf_files()).SerializeToString()

    def build(writer):
        channel = writer.register_channel("/p", "protobuf", writer.register_schema("lab.Reading", "protobuf", schema))
        for i in range(3):
            writer.add_message(channel, i, b"", i)

    assert assert_agreement(log_of(tmp_path / "log.mcap", build)) > 40


ROS = {
    "float64 x\nstring s\nfloat32[3] three\nint8[<=5] few\nuint64 big\nbool yes\nbyte b\nchar c\nint64[] many\n": [
        {
            "x": i / 3,
            "s": "grün" * i,
            "three": [i, 2, 3],
            "few": [-1] * 5,
            "big": 2**63,
            "yes": True,
            "b": 255,
            "c": 65,
            "many": [-(2**62), i],
        }
        for i in range(5)
    ],
    "P[] points\nP[2] two\nuint8 K=7\nfloat64 last -1.5  # with a default\n"
    + "=" * 80
    + "\nMSG: lab/P\nfloat32 x\nstring name\nuint8[2] rgb\n": [
        {
            "points": [{"x": 0.5 * k, "name": "n" * k, "rgb": [k, i]} for k in range(100)],
            "two": [{"x": i, "name": "", "rgb": [0, 1]}] * 2,
            "last": -i,
        }
        for i in range(3)
    ],
}


@pytest.mark.parametrize("text", ROS, ids=["kinds", "nested"])
def test_ros_2_by_its_own_writer(tmp_path, text):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        schema = writer.register_msgdef("lab/msg/T", text)
        for i, message in enumerate(ROS[text]):
            writer.write_message("/t", schema, message, i, i)
        writer.finish()
    assert assert_agreement(path) > 60


def assert_bag_agreement(folder):
    """Every message of a bag as rosbags reads it: counts, times and numbers."""
    from rosbags.typesys import Stores, get_typestore

    store, rows = get_typestore(Stores.ROS2_JAZZY), {}
    with ROSBAGS.Reader(folder) as reader:
        for connection, stamp, raw in reader.messages():
            values = dict(numbers_of_rosbags(store.deserialize_cdr(raw, connection.msgtype)))
            rows.setdefault(connection.topic, []).append((stamp, values))
    found = ours(folder)
    assert set(found) == set(rows)
    for topic, (columns, times, values) in found.items():
        assert times == [stamp for stamp, _ in rows[topic]]
        assert [dict(zip(columns, row, strict=True)) for row in values] == [expected for _, expected in rows[topic]]
    return sum(map(len, rows.values()))


def numbers_of_rosbags(item, path=""):
    if isinstance(item, np.ndarray | list):
        for i, inner in enumerate(item):
            yield from numbers_of_rosbags(inner, f"{path}[{i}]")
    elif hasattr(item, "__msgtype__"):
        for name in item.__dataclass_fields__:
            if not name.startswith("__"):
                yield from numbers_of_rosbags(getattr(item, name), f"{path}.{name}" if path else name)
    elif not isinstance(item, str):
        yield path, float(item)


@pytest.mark.parametrize(
    ("storage", "packed", "version"),
    [
        ("SQLITE3", None, 8),
        ("SQLITE3", "FILE", 9),
        ("SQLITE3", "MESSAGE", 9),
        ("MCAP", None, 9),
        ("MCAP", "MESSAGE", 8),
    ],
)
def test_bags_by_rosbags(tmp_path, storage, packed, version):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind, other = "geometry_msgs/msg/Vector3", "std_msgs/msg/UInt8MultiArray"
    writer = ROSBAGS.Writer(tmp_path / "bag", version=version, storage_plugin=ROSBAGS.StoragePlugin[storage])
    if packed:
        writer.set_compression(ROSBAGS.CompressionMode[packed], ROSBAGS.CompressionFormat.ZSTD)
    with writer:
        v, a = (writer.add_connection(f"/{name}", name, typestore=store) for name in (kind, other))
        writer.add_connection("/silent", kind, typestore=store)
        for i in range(20):
            writer.write(v, 1000 + i, store.serialize_cdr(store.types[kind](x=i / 3, y=-i, z=1e300), kind))
            layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=i)
            message = store.types[other](layout=layout, data=np.arange(5, dtype=np.uint8))
            writer.write(a, 1000 + i, store.serialize_cdr(message, other))
    assert assert_bag_agreement(tmp_path / "bag") == 40
