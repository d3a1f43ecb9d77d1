"""Blocks of messages give the bytes that single messages give."""

import io

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from palpate_devices.mcap_blocks import add_messages


def written(one_by_one, compression=CompressionType.ZSTD, cut=700):
    """A log of two channels whose messages are of different sizes, in blocks of many sizes."""
    file, random = io.BytesIO(), np.random.default_rng(0)
    writer = Writer(file, chunk_size=5000, compression=compression)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema("numbers", "ros2msg", b"float64 x")
    channels = [writer.register_channel(f"/{i}", "cdr", schema) for i in range(3)]
    for number, length in enumerate([1, 2, 0, 300, 7, cut, 1]):
        channel, width = channels[number % 2], 24 + 100 * (number % 2)
        sent = 10**18 + random.integers(0, 10**9, length)
        logged, data = sent + random.integers(0, 10**6, length), random.integers(0, 256, (length, width), np.uint8)
        if one_by_one:
            for log_time, publish_time, message in zip(logged.tolist(), sent.tolist(), data, strict=True):
                writer.add_message(channel, log_time=log_time, data=message.tobytes(), publish_time=publish_time)
        else:
            add_messages(writer, channel, logged, sent, data)
        if number == 3:
            writer.flush()
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize("compression", CompressionType)
def test_the_log_is_the_same_to_the_byte(compression):
    assert written(False, compression) == written(True, compression)


def test_a_reader_of_the_library_finds_every_message_in_its_order():
    log = written(False)
    times = [message.log_time for _, _, message in make_reader(io.BytesIO(log)).iter_messages()]
    assert len(times) == 1011
    assert times == sorted(times)


def test_a_library_without_those_parts_is_asked_for_one_message_after_the_other():
    asked = []

    class Other:
        def add_message(self, channel, log_time, data, publish_time):
            asked.append((channel, log_time, data, publish_time))

    add_messages(Other(), 4, np.array([1, 2]), np.array([3, 4]), np.array([[5], [6]], np.uint8))
    assert asked == [(4, 1, b"\5", 3), (4, 2, b"\6", 4)]


def test_the_library_has_the_parts_that_we_look_for():
    writer = Writer(io.BytesIO())
    parts = ("chunk_builder", "chunk_size", "statistics", "maybe_finalize_chunk")
    assert all(hasattr(writer, f"_Writer__{part}") for part in parts)
