"""Types of ROS as rosbags has them: the same fields and hashes, and the numbers of messages that it writes."""

import random

import numpy as np
import pytest
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import Field, parse_definitions, short_name
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.standard_types import STANDARD_TYPES
from palpate_records.messages.topics import Messages, Topic
from palpate_ros2.type_hash import type_hash

pytest.importorskip("rosbags")
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
READ = (
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/PoseArray",
    "nav_msgs/msg/Odometry",
)
NEVER = np.zeros(1, np.int64)


def field_of(name, description):
    """A field as `parse_definitions` gives it."""
    kind, inside = description
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        (_, element), size = inside
        count = size if kind == Nodetype.ARRAY else None
        return Field(name, short_name(element if isinstance(element, str) else element[0]), count, many=True)
    return Field(name, short_name(inside if isinstance(inside, str) else inside[0]))


def without_fields(fields):
    """rosbags gives an empty structure the byte that it takes."""
    return tuple(field for field in fields if field.name != "structure_needs_at_least_one_member")


@pytest.mark.parametrize(("store", "version"), [(ROS1, 1), (ROS2, 2)], ids=["ros1", "ros2"])
def test_definitions_have_the_same_fields(store, version):
    compared = 0
    for name in store.fielddefs:
        text, _ = store.generate_msgdef(name, ros_version=version)
        if not text.strip() or name.startswith("builtin_interfaces/"):
            continue
        for other, fields in parse_definitions(name, text, ros1=version == 1).items():
            if other.startswith("builtin_interfaces/"):
                continue
            full = other.replace("/", "/msg/")
            expected = [field_of(*one) for one in store.fielddefs[full][1]]
            signed = {"byte": "int8"} if version == 1 else {}
            expected = [Field(f.name, signed.get(f.type, f.type), f.count, f.many) for f in expected]
            assert fields == without_fields(expected), other
            compared += 1
    assert compared > 400


@pytest.mark.parametrize("name", sorted(STANDARD_TYPES))
def test_standard_types_are_those_of_ros_2_and_so_are_their_hashes(name):
    full = name.replace("/", "/msg/")
    assert parse_definitions(name, "")[name] == tuple(field_of(*one) for one in ROS2.fielddefs[full][1])
    assert type_hash(full) == ROS2.hash_rihs01(full)


def filled(store, name, dice):
    """A message of a type with random contents."""
    values = []
    for _, (kind, inside) in store.fielddefs[name][1]:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (element, what), size = inside
            count = size if kind == Nodetype.ARRAY else dice.randint(0, 4)
            many = [value(store, element, what, dice) for _ in range(count)]
            numeric = element == Nodetype.BASE and what[0] != "string"
            values.append(np.array(many, what[0]) if numeric else many)
        else:
            values.append(value(store, kind, inside, dice))
    return store.types[name](*values)


def value(store, kind, what, dice):
    if kind == Nodetype.NAME:
        return filled(store, what, dice)
    if what[0] == "string":
        return "x" * dice.randint(0, 9)
    return dice.randint(0, 100) if "int" in what[0] else dice.uniform(-1.0, 1.0)


def numbers(message, path):
    for part in path.split("."):
        name, _, place = part.partition("[")
        message = getattr(message, name)
        message = message[int(place[:-1])] if place else message
    return np.atleast_1d(np.asarray(message, float))


@pytest.mark.parametrize(("store", "version"), [(ROS1, 1), (ROS2, 2)], ids=["ros1", "ros2"])
@pytest.mark.parametrize("name", READ)
def test_messages_that_rosbags_writes_are_read_to_the_bit(store, version, name):
    dice = random.Random(name)
    messages = [filled(store, name, dice) for _ in range(20)]
    write = store.serialize_ros1 if version == 1 else store.serialize_cdr
    text, _ = store.generate_msgdef(name, ros_version=version)
    topic = Topic("/t", name, "ros1" if version == 1 else "cdr", f"ros{version}msg", text.encode())
    decoder, compared = decoder_of(topic), 0
    for message in messages:
        raw = bytes(write(message, name))
        for path, count in decoder.fields(raw).items():
            read = [FieldReading(path, k) for k in range(count)] if count is not None else [FieldReading(path)]
            if read:
                table = decoder.read(Messages.joined([raw], NEVER, NEVER), read)
                assert table.values[0].tolist() == numbers(message, path).tolist(), path
                compared += len(read)
    assert compared > 100
