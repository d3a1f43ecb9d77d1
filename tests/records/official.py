"""What official readers find in a log, and what the package does: both by path, message by message."""

import json
import math
from collections.abc import Mapping

import numpy as np
import pytest
from mcap.decoder import DecoderFactory
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from palpate_kit.logs.draft_pipeline import recording_of

ProtobufDecoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory


class JsonDecoder(DecoderFactory):
    def decoder_for(self, message_encoding, schema):
        return json.loads if message_encoding == "json" else None


DECODERS = (ProtobufDecoder, Ros2Decoder, JsonDecoder)


def numbers(item, path=""):
    """Every number of a decoded message by its path."""
    if isinstance(item, bool | int | float):
        yield path, float(item) if abs(item) < 1.7e308 else math.nan
    elif isinstance(item, bytes):
        yield from ((f"{path}[{i}]", float(byte)) for i, byte in enumerate(item))
    elif isinstance(item, Mapping):
        for name, inner in item.items():
            yield from numbers(inner, f"{path}.{name}" if path else str(name))
    elif isinstance(item, str) or item is None:
        return
    elif hasattr(item, "DESCRIPTOR"):
        for field in item.DESCRIPTOR.fields:
            yield from numbers(getattr(item, field.name), f"{path}.{field.name}" if path else field.name)
    elif hasattr(item, "__len__"):
        for i, inner in enumerate(item):
            yield from numbers(inner, f"{path}[{i}]")
    else:
        for name in item.__slots__:
            yield from numbers(getattr(item, name), f"{path}.{name}" if path else name)


def theirs(path):
    """By topic and type: log time and numbers of every message that an official reader decodes."""
    found = {}
    with path.open("rb") as file:
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            rows = found.setdefault((channel.topic, schema.name if schema else ""), [])
            for kind in DECODERS:
                decode = kind().decoder_for(channel.message_encoding, schema)
                if decode is not None:
                    try:
                        rows.append((message.log_time, dict(numbers(decode(message.data)))))
                    except Exception:  # a message that they cannot read, either
                        rows.append((message.log_time, None))
    return found


def ours(path, notes=None):
    """By topic: columns, log times and values."""
    found = {}
    for topic, columns, batch in recording_of(path).tables(path, notes):
        found.setdefault(topic, (columns, [], []))
        found[topic][1].extend(batch.received.tolist())
        found[topic][2].extend(batch.values.tolist())
    return found


def assert_agreement(path, named=None):
    """Every number of every message that they decode is in our table at its time, and there is no other row."""
    mine, compared = ours(path), 0
    counts = {entry.name: entry.messages for entry in recording_of(path).survey(path).topics if entry.messages}
    for (topic, kind), rows in theirs(path).items():
        name = (named or {}).get((topic, kind), topic)
        assert counts.pop(name) == len(rows)
        good = [(time, values) for time, values in rows if values is not None]
        columns, times, table = mine.pop(name)
        assert times == [time for time, _ in good]
        first = good[0][1]
        assert set(columns) == set(first)
        for row, (_, values) in zip(table, good, strict=True):
            expected = [values.get(column, math.nan) for column in columns]
            np.testing.assert_array_equal(row, expected)
            compared += len(columns)
    assert (mine, counts) == ({}, {})
    return compared


STYLES = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "plain": {"compression": CompressionType.NONE},
    "no chunks": {"use_chunking": False},
    "no checksums": {"enable_crcs": False},
    "no index": {"index_types": IndexType.NONE},
    "no statistics": {"use_statistics": False},
    "no repeats": {"repeat_channels": False, "repeat_schemas": False},
    "nothing but data": {
        "use_chunking": False,
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_summary_offsets": False,
        "index_types": IndexType.NONE,
        "enable_crcs": False,
    },
    "data checksum": {"enable_data_crcs": True},
    "a message a chunk": {"chunk_size": 1},
}


def log_of(path, build, **style):
    with path.open("wb") as file:
        writer = Writer(file, **style)
        writer.start()
        build(writer)
        writer.finish()
    return path


def json_topic(writer, topic, messages):
    channel = writer.register_channel(topic, "json", writer.register_schema("lab", "jsonschema", b"{}"))
    for i, message in enumerate(messages):
        raw = message if isinstance(message, bytes) else json.dumps(message).encode()
        writer.add_message(channel, i * 10**6, raw, i * 10**6)


def ros_topic(writer, topic, kind, text, bodies):
    channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode()))
    for i, body in enumerate(bodies):
        writer.add_message(channel, i * 1000, b"\0\1\0\0" + body, i * 1000)
