"""Every type that a mapping is likely to name, written and read by another library: the numbers are the same."""

import numpy as np
import pytest
from mcap_ros2.decoder import DecoderFactory
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import PRIMITIVES, parse_definitions, short_name
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.standard_types import STANDARD_TYPES

TYPES = (
    *("geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Wrench", "geometry_msgs/msg/PoseStamped"),
    *("geometry_msgs/msg/Pose", "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage"),
    *("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist", "sensor_msgs/msg/JointState"),
    *("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray", "std_msgs/msg/Int16MultiArray"),
    *("std_msgs/msg/Float64", "std_msgs/msg/UInt8", "geometry_msgs/msg/AccelStamped"),
)
WORDS = ("", "a", "tool0", "ft_sensor0_wrench", "é")


def definition(kind):
    """The text that a log carries: the type, then all that it needs."""
    root = short_name(kind)
    needed = [name for name in parse_definitions(kind, "") if name != root]

    def text(name):  # the other library wants the whole names of types
        return "\n".join(
            f"{f.type}{'' if not f.many else '[]' if f.count is None else f'[{f.count}]'} {f.name}"
            for f in parse_definitions(name, STANDARD_TYPES[name])[name]
        )

    return ("\n" + "=" * 80 + "\n").join([text(root), *(f"MSG: {name}\n{text(name)}" for name in needed)])


def value(kind, definitions, random, count):
    """A message of random numbers, as nested dictionaries."""
    if kind in ("string", "wstring"):
        return WORDS[random.integers(len(WORDS))]
    if kind in PRIMITIVES:
        code = PRIMITIVES[kind]
        if code[0] == "f":
            return float(np.float32(random.normal())) if code == "f4" else float(random.normal())
        bounds = np.iinfo(code)
        return int(random.integers(bounds.min, bounds.max, endpoint=True, dtype=code))
    found = {}
    for field in definitions[kind]:
        many = (field.count if field.count is not None else count) if field.many else None
        if many is None:
            found[field.name] = value(field.type, definitions, random, count)
        else:
            found[field.name] = [value(field.type, definitions, random, count) for _ in range(many)]
    return found


def numbers(item, path=""):
    """Every number of nested dictionaries by its path."""
    if isinstance(item, dict):
        for name, inner in item.items():
            yield from numbers(inner, f"{path}.{name}" if path else name)
    elif isinstance(item, list):
        for i, inner in enumerate(item):
            yield from numbers(inner, f"{path}[{i}]")
    elif not isinstance(item, str):
        yield path, float(item)


@pytest.mark.parametrize("kind", TYPES)
def test_numbers_of_every_type_are_those_that_another_library_wrote_and_reads(tmp_path, kind):
    from mcap.reader import make_reader
    from mcap_ros2.writer import Writer as Ros2Writer

    random, definitions = np.random.default_rng(len(kind)), parse_definitions(kind, "")
    messages = [value(short_name(kind), definitions, random, count) for count in (3, 3, 0, 1, 3, 2, 3)]
    path = tmp_path / "log.mcap"
    writer = Ros2Writer(str(path))
    schema = writer.register_msgdef(kind, definition(kind))
    for i, message in enumerate(messages):
        writer.write_message("/topic", schema, message, i, i)
    writer.finish()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert len([decoded for *_, decoded in reader.iter_decoded_messages()]) == len(messages)
    log = McapFile(path)
    decoder = decoder_of(log.topics["/topic"])
    ((_, block),) = log.blocks({"/topic"})
    assert len(block) == len(messages)
    for i, message in enumerate(messages):
        expected = dict(numbers(message))
        table = decoder.read(block[np.array([i])], [FieldReading.parse(name) for name in expected])
        np.testing.assert_array_equal(table.values[0], list(expected.values()), err_msg=f"{kind}, message {i}")
    # All of them at once: what a message lacks is missing, and not what another one has there.
    names = list(dict.fromkeys(name for message in messages for name, _ in numbers(message)))
    table = decoder.read(block, [FieldReading.parse(name) for name in names])
    expected = [[dict(numbers(message)).get(name, np.nan) for name in names] for message in messages]
    np.testing.assert_array_equal(table.values, expected)
