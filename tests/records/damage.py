"""Damaged MCAP logs, and which of their messages are still whole, told by the plain `mcap` library alone."""

import io
import itertools
import struct
from collections import Counter
from dataclasses import dataclass

import numpy as np
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from palpate_devices.messages import WRENCH

from tests.records.bags import wrench_message

WRITERS = {
    "zstd": {"compression": CompressionType.ZSTD},
    "zstd, data checksum": {"compression": CompressionType.ZSTD, "enable_data_crcs": True},
    "lz4": {"compression": CompressionType.LZ4},
    "plain": {"compression": CompressionType.NONE},
    "plain, data checksum": {"compression": CompressionType.NONE, "enable_data_crcs": True},
}


def write(style, count=4000, chunk=8192):
    """The bytes of a log of two topics."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=chunk, **WRITERS[style])
    writer.start(profile="ros2", library="damage")
    schema = writer.register_schema(WRENCH.name, "ros2msg", WRENCH.definition.encode())
    channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/ft/wrench", "/arm/wrench")]
    rng = np.random.default_rng(5)
    for i in range(count):
        stamp = 10**9 + i * 10**6
        for channel in channels[: 1 + (i % 2)]:
            message = wrench_message(stamp, "tool0", rng.standard_normal(6))
            writer.add_message(channel, stamp, message, stamp, i)
    writer.add_attachment(0, 0, "notes.txt", "text/plain", b"notes")
    writer.finish()
    return file.getvalue()


@dataclass(frozen=True)
class Damaged:
    """What is left of a log: its bytes, and which pieces of the first one are in it as they were."""

    raw: bytes
    kept: list[tuple[int, int]]  # begin and end in the log as it was written


def _without(raw, begin, end, instead=b""):
    return Damaged(raw[:begin] + instead + raw[end:], [(0, begin), (end, len(raw))])


def one_bit(raw, rng):
    at = int(rng.integers(len(raw)))
    return _without(raw, at, at + 1, bytes([raw[at] ^ (1 << int(rng.integers(8)))]))


def many_bits(raw, rng):
    places = sorted({int(at) for at in rng.integers(0, len(raw), 20)})
    damaged = bytearray(raw)
    for at in places:
        damaged[at] ^= 1 << int(rng.integers(8))
    edges = [-1, *places, len(raw)]
    return Damaged(bytes(damaged), [(a + 1, b) for a, b in itertools.pairwise(edges)])


def overwritten(raw, rng):
    begin = int(rng.integers(len(raw)))
    end = min(begin + int(rng.integers(1, 30_000)), len(raw))
    noise = rng.bytes(end - begin) if rng.random() < 0.5 else bytes(end - begin)
    return _without(raw, begin, end, noise)


def cut_short(raw, rng):
    begin = int(rng.integers(60, len(raw)))
    return _without(raw, begin, len(raw))


def cut_out(raw, rng):
    begin = int(rng.integers(len(raw)))
    return _without(raw, begin, min(begin + int(rng.integers(1, 30_000)), len(raw)))


def put_in(raw, rng):
    begin = int(rng.integers(len(raw)))
    return _without(raw, begin, begin, rng.bytes(int(rng.integers(1, 20_000))))


def wrong_lengths(raw, rng):
    """Three records whose length is not what it was."""
    heads = [at for _, at, _ in top(raw)]
    damaged, edges = bytearray(raw), [0]
    for at in sorted(rng.choice(heads, 3, replace=False).tolist()):
        old = struct.unpack_from("<Q", raw, at + 1)[0]
        new = [0, old + int(rng.integers(1, 9)), old + 20_000, max(old - 5, 0), 2**40, 2**64 - 1][rng.integers(6)]
        struct.pack_into("<Q", damaged, at + 1, new if new != old else old + 1)
        edges += [at + 1, at + 9]
    edges.append(len(raw))
    return Damaged(bytes(damaged), list(zip(edges[::2], edges[1::2], strict=True)))


def no_ends(raw, rng):
    """The first and the last bytes are gone: magic, first chunk's head, summary."""
    begin, end = int(rng.integers(1, 200)), len(raw) - int(rng.integers(1, 3000))
    middle = raw[begin:end]
    return Damaged(rng.bytes(begin) + middle + bytes(int(rng.integers(0, 50))), [(begin, end)])


KINDS = (one_bit, many_bits, overwritten, cut_short, cut_out, put_in, wrong_lengths, no_ends)


def top(raw):
    """Kind, begin and end of every record of a whole log."""
    at = 8
    while at < len(raw) - 8:
        length = struct.unpack_from("<Q", raw, at + 1)[0]
        yield raw[at], at, at + 9 + length
        at += 9 + length


def chunks(raw):
    """Begin and end of each chunk of a whole log, and its messages."""
    found = [r for r in StreamReader(io.BytesIO(raw), emit_chunks=True).records if type(r).__name__ == "Chunk"]
    places = [(begin, end) for kind, begin, end in top(raw) if kind == 6]
    names = {r.id: r.topic for r in StreamReader(io.BytesIO(raw)).records if type(r).__name__ == "Channel"}
    for (begin, end), chunk in zip(places, found, strict=True):
        inner = [r for r in breakup_chunk(chunk) if type(r).__name__ == "Message"]
        yield begin, end, Counter((names[m.channel_id], m.log_time, m.sequence, m.data) for m in inner)


def whole(damaged, written):
    """The messages of the chunks of which no byte was touched; `written` is what `chunks` said."""
    kept = damaged.kept
    found = Counter()
    for begin, end, messages in written:
        if any(a <= begin and end <= b for a, b in kept):
            found += messages
    return found


def messages(path):
    """What the plain reader finds in a log."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        items = reader.iter_messages(log_time_order=False)
        return Counter((channel.topic, m.log_time, m.sequence, m.data) for _, channel, m in items)
