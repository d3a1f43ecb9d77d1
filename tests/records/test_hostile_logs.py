"""Logs made to exhaust memory or time: each is refused in words, by what it has bytes for."""

import json
import struct
import time
import tracemalloc
from contextlib import suppress
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_records.bags.sqlite_bag import SqliteBag
from palpate_records.mcap import mcap_records as records
from palpate_records.messages.cdr import MessageLayout, _Walker, walk
from palpate_records.messages.cdr_decoder import CdrDecoder
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import parse_definitions
from palpate_records.messages.memory_budget import FREE, Budget
from palpate_records.messages.protobuf_messages import bounded_parser
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Messages, Topic

from tests.processes import run
from tests.records.bags import write_bag

HEAD = b"\0\1\0\0"
PART = "\n" + "=" * 80 + "\nMSG: "
MEGABYTE = 1 << 20


def definition(*types: str) -> str:
    return PART.join(types)


def walked(monkeypatch) -> list[str]:
    """The structures that walkers go into from now on."""
    found: list[str] = []
    whole = _Walker.walk_message

    def counted(walker, type_name, prefix):
        found.append(type_name)
        whole(walker, type_name, prefix)

    monkeypatch.setattr(_Walker, "walk_message", counted)
    return found


CUBE = ["A[1000] a", "a/A\nB[1000] b", "a/B\nC[1000] c"]


@pytest.mark.parametrize(
    ("text", "payload", "words"),
    [
        (definition("A[] a", "a/A\nE[1000] e", "a/E\n"), struct.pack("<I", 1200) + bytes(1200), "ends before"),
        (definition("A[] a", "a/A\nE[16] e", "a/E\n"), struct.pack("<I", 1200) + bytes(1200), "ends before"),
        (definition(*CUBE, "a/C\n"), bytes(1200), "ends before"),
        (definition(*CUBE, "a/C\nuint8 x"), bytes(1200), "ends before"),
        (definition(*CUBE, "a/C\nuint8[] x"), bytes(400_000), "more than 32 MiB of memory"),
        ("string[] words", struct.pack("<I", 1 << 20) + bytes(4 << 20), "more than 36 MiB of memory"),
        ("wstring[] words", struct.pack("<I", 1 << 20) + bytes(4 << 20), "more than 36 MiB of memory"),
        ("string words", struct.pack("<I", (1 << 32) - 1) + bytes(40), "ends before"),
        ("wstring words", struct.pack("<I", (1 << 32) - 1) + bytes(40), "ends before"),
        ("float64[] numbers", struct.pack("<I", (1 << 32) - 1) + bytes(40), "ends before"),
        ("A[] a" + PART + "a/A\n", struct.pack("<I", (1 << 32) - 1) + bytes(40), "ends before"),
        (f"A[200000] {'n' * 100_000}{PART}a/A\nuint8 x", bytes(200_000), "more than 32 MiB of memory"),
    ],
)
def test_a_message_that_becomes_too_much_is_refused_before_it_is_walked(monkeypatch, text, payload, words):
    structures = walked(monkeypatch)
    with pytest.raises(LogError, match=words):
        walk(parse_definitions("a/T", text), "a/msg/T", HEAD + payload)
    assert len(structures) < 140_000


@pytest.mark.slow
def test_as_much_as_there_are_bytes_for_is_read():
    points = definition("P[] points", "a/P\nfloat64 x\nfloat64 y\nfloat64 z")
    payload = struct.pack("<I4x", 20_000) + bytes(24 * 20_000)
    assert len(walk(parse_definitions("a/T", points), "a/T", HEAD + payload).places) == 60_000
    numbers = struct.pack("<I4x", 4_000_000) + bytes(32_000_000)
    assert walk(parse_definitions("a/T", "float64[] x"), "a/T", HEAD + numbers).places["x"].count == 4_000_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (definition("A a", "a/A\nB b", "a/B\nA a"), "contains itself"),
        ("T t", "contains itself"),
        ("uint8[0] nothing", "has 0 elements"),
        (f"uint8[{'9' * 5000}] x", "has 99999999999999999999 elements"),
        ("uint8[4294967296] x", "has 4294967296 elements"),
        ("module a { struct T { octet x[99999999999999]; }; };", "is not a number of elements"),
        ("module a { struct T { octet x[65536][65536][65536]; }; };", "more than 4294967295 elements"),
        (f"module a {{ struct T {{ octet x{'[9]' * 300}; }}; }};", "or 16 dimensions"),
        ("module a { struct T { octet x[1²]; }; };", "is not a number of elements"),
        ("struct T { " + "/*x" * 300_000, "cannot be read as IDL"),
        ("struct T { " + '"\\' * 500_000, "cannot be read as IDL"),
        ("struct T { " + "'\\" * 500_000, "cannot be read as IDL"),
        ("float64 x\n" * 200_000, "more than 1048576 is damage"),
    ],
)
def test_definitions_without_end_or_measure(text, words):
    began = time.process_time()
    with pytest.raises(LogError, match=words) as refusal:
        parse_definitions("a/T", text)
    assert time.process_time() - began < 2.0  # quadratic: minutes
    assert len(str(refusal.value)) < 1000


@pytest.mark.slow
def test_layouts_that_all_differ_are_neither_kept_nor_compared_with_all(monkeypatch):
    """Two sequences of one total length: every message of the block has a layout of its own."""
    topic = Topic("/t", "a/T", schema=b"uint8[] a\nuint8[] b\nuint8[] c")

    def message(i, j, total=96):
        counts = i, j, total - i - j
        parts = (struct.pack("<I", n) + bytes(n + -n % 4) for n in (4 * count for count in counts))
        return HEAD + b"".join(parts)

    payloads = [message(i, j) for i in range(48) for j in range(48)]
    stamps = np.arange(len(payloads))
    compared, whole = [], MessageLayout.matches

    def counted(layout, some, pinned=()):
        compared.append(len(some))
        return whole(layout, some, pinned)

    monkeypatch.setattr(MessageLayout, "matches", counted)
    decoder = CdrDecoder(topic)
    table = decoder.read(Messages.joined(payloads, stamps, stamps), [FieldReading("c", 0)])
    assert len(table.rows) == len(payloads)
    assert sum(compared) < len(payloads) ** 2 / 8
    assert len(decoder._layouts) == 64


@pytest.mark.slow
def test_layouts_are_kept_as_long_as_they_are_small():
    decoder = CdrDecoder(Topic("/t", "a/T", schema=definition("E[] a", "a/E\nuint8 x").encode()))
    payloads = [HEAD + struct.pack("<I", n) + bytes(n) for n in range(20_000, 20_008)]
    for payload in payloads:
        stamps = np.zeros(1, np.int64)
        decoder.read(Messages.joined([payload], stamps, stamps), [])
    assert sum(layout.cost for layout in decoder._layouts) <= FREE


@pytest.mark.slow
def test_a_topic_is_walked_in_proportion_to_its_bytes():
    """Structures within structures: 30 elements for every byte, in message after message."""
    chain = [f"a/S{i}\nS{i + 1} s" for i in range(28)]
    decoder = CdrDecoder(Topic("/t", "a/T", schema=definition("S0[] x", *chain, "a/S28\nuint8 x").encode()))
    payloads = [HEAD + struct.pack("<I", n) + bytes(n) for n in range(1000, 1100)]
    with pytest.raises(LogError, match="/t is damaged"):
        _ = [decoder.fields(payload) for payload in payloads]


@pytest.mark.parametrize(
    "text",
    [
        "[" * 1_000_000 + "]" * 1_000_000,
        "[" + "[]," * 4_000_000 + "[]]",
        "[" + "0," * 8_000_000 + "0]",
        '{"a":' + "[" + '"",' * 4_000_000 + '""]}',
        json.dumps({"k" * 100_000: {f"{i}": 0 for i in range(10_000)}}),
    ],
)
def test_json_that_becomes_too_much(text):
    decoder = decoder_of(Topic("/t", "lab", "json", "jsonschema", b"{}"))
    tracemalloc.start()
    with pytest.raises(LogError, match="topic /t"):
        decoder.fields(text.encode())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100 * MEGABYTE


def test_numbers_of_json_that_no_float_holds():
    decoder = decoder_of(Topic("/t", "lab", "json", "jsonschema", b"{}"))
    huge = "9" * 400
    payload = f'{{"x": {huge}, "y": 2.5, "stamp": {{"sec": {huge}, "nanosec": 1}}}}'.encode()
    stamps = np.zeros(1, np.int64)
    table = decoder.read(Messages.joined([payload], stamps, stamps), [FieldReading("x"), FieldReading("y")])
    assert np.isnan(table.values[0, 0])
    assert (table.values[0, 1], table.stamps) == (2.5, None)


def protobuf_class(fields: int):
    """A type whose field `inner` repeats a type of many numbers."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name=f"lab{fields}.proto", package="lab", syntax="proto3")
    inner, outer = file.message_type.add(name="Inner"), file.message_type.add(name="Outer")
    for number in range(1, fields + 1):
        inner.field.add(name=f"x{number}", number=number, type=1, label=1)
    outer.field.add(name="inner", number=1, type=11, label=3, type_name=".lab.Inner")
    outer.field.add(name="raw", number=2, type=12, label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("lab.Outer"))


def test_protobuf_that_becomes_too_much():
    parse = bounded_parser(protobuf_class(1000))
    with pytest.raises(LogError, match="more than 32 MiB of memory"):
        parse(b"\x0a\x00" * 20_000)
    assert len(parse(b"\x0a\x00" * 1000).inner) == 1000
    raw = bytes(20 * MEGABYTE)
    assert len(parse(b"\x12" + b"\x80\x80\x80\x0a" + raw).raw) == len(raw)


@pytest.mark.parametrize(
    "text",
    [
        'int32 __name__;open("{mark}","w");b=1\nfloat64 x',
        'string x=1\nint32 a;open("{mark}","w")=1',
        'float64 x"""+str(open("{mark}","w"))+"""',
        "float64 x\n===\nMSG: a/B;open\nfloat64 y",
    ],
)
def test_a_definition_of_ros_1_is_no_program(tmp_path, text):
    """Some readers of ROS 1 execute what they make of a definition."""
    mark = tmp_path / "executed"
    for name in ("a/T", f'T:\n  open("{mark}", "w")\nclass T'):
        with suppress(LogError):
            decoder_of(Topic("/t", name, "ros1", "ros1msg", text.replace("{mark}", str(mark)).encode())).fields(
                bytes(8)
            )
    assert not mark.exists()


def test_structures_of_nothing_in_ros_1_take_no_time():
    """They take no bytes of a message, either."""
    parts = [f"a/A{k}\nA{k + 1} x\nA{k + 1} y" for k in range(30)]
    for text in (definition("A[] a", "a/A\nB b", "a/B\n"), definition("A0 a", *parts, "a/A30\n")):
        decoder = decoder_of(Topic("/t", "a/T", "ros1", "ros1msg", text.encode()))
        with pytest.raises(LogError, match=r"more than 32 MiB of memory|ends before its fields do"):
            decoder.fields(b"\xff\xff\xff\xff")


def chunk(name: str, packed: bytes, size: int) -> bytes:
    return struct.pack("<QQQII", 0, 0, size, 0, len(name)) + name.encode() + struct.pack("<Q", len(packed)) + packed


@pytest.mark.parametrize("size", [1 << 40, 1 << 62, 200 << 20])
def test_a_chunk_is_not_unpacked_beyond_what_its_bytes_can_be(size):
    tracemalloc.start()
    for name, packed in (("zstd", zstandard.compress(bytes(1000))), ("lz4", lz4.frame.compress(bytes(1000)))):
        with pytest.raises(records.Damage, match="claims"):
            records.open_chunk(chunk(name, packed, size), records.Unpacker())
    assert tracemalloc.get_traced_memory()[1] < 10 * MEGABYTE
    tracemalloc.stop()


def test_a_chunk_of_records_that_are_no_messages_is_damage():
    began = time.process_time()
    with pytest.raises(records.Damage, match="records that are not messages"):
        records.scan(bytes(60 * MEGABYTE))
    assert time.process_time() - began < 2.0


@pytest.mark.slow
def test_messages_compressed_one_by_one_are_unpacked_a_few_at_a_time(tmp_path):
    packed = zstandard.compress(bytes(16 * MEGABYTE))
    path = write_bag(tmp_path / "bag.db3", [("/t", "std_msgs/msg/String", [(i, packed) for i in range(40)])])
    tracemalloc.start()
    counts = [len(messages) for _, messages in SqliteBag(path, packed_messages=True).blocks({"/t"})]
    assert tracemalloc.get_traced_memory()[1] < 200 * MEGABYTE
    tracemalloc.stop()
    assert sum(counts) == 40


def test_a_compressed_message_that_claims_gigabytes_is_refused(tmp_path):
    claims = zstandard.ZstdCompressor().compressobj(size=1 << 40)
    packed = claims.compress(bytes(1000)) + claims.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
    path = write_bag(tmp_path / "bag.db3", [("/t", "std_msgs/msg/String", [(0, packed)])])
    with pytest.raises(LogError, match="claims to become 1099511627776"):
        list(SqliteBag(path, packed_messages=True).blocks({"/t"}))


def log_of(path: Path, text: str, payloads: list[bytes], compression: CompressionType) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start("ros2", "test")
        schema = writer.register_schema("a/msg/T", "ros2msg", text.encode())
        channel = writer.register_channel("/t", "cdr", schema)
        for i, payload in enumerate(payloads):
            writer.add_message(channel, i, payload, i)
        writer.finish()
    return path


SURVEY = (
    "import resource, sys\n"
    "from pathlib import Path\n"
    "from palpate_devices.mcap_replay import McapReplay\n"
    "used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()\n"
    "resource.setrlimit(resource.RLIMIT_AS, (used + (200 << 20), -1))\n"
    "(topic,) = McapReplay.survey(Path(sys.argv[1])).topics\n"
    "print(topic.messages, topic.note)\n"
)


@pytest.mark.slow
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_millions_of_empty_texts_in_a_few_kilobytes(tmp_path, compression):
    payload = HEAD + struct.pack("<I", 15_000_000) + bytes(60_000_000)
    path = log_of(tmp_path / "log.mcap", "string[] words", [payload], compression)
    assert path.stat().st_size < 300_000
    done = run(SURVEY, path, timeout=60)
    assert "1 a message of a/msg/T is damaged: it has 60000008 bytes" in done.stdout, done.stderr[-2000:]


@pytest.mark.slow
def test_a_table_of_one_long_message_and_many_short_ones_is_left_out(tmp_path):
    long = HEAD + struct.pack("<I", 8_000) + bytes(8_000 * 8)
    short = [HEAD + struct.pack("<I", 0)] * 2000
    text = definition("P[] p", "a/P\nuint32 x\nuint32 y")
    path = log_of(tmp_path / "log.mcap", text, [long, *short], CompressionType.ZSTD)
    assert list(McapReplay.tables(path)) == []
    assert sum(len(b.time) for _, _, b in McapReplay.tables(log_of(path, text, [long] * 3, CompressionType.ZSTD))) == 3


def test_the_budget_grows_with_the_bytes():
    Budget("it", 1000).charge(FREE + 1000)
    with pytest.raises(LogError, match="it is damaged: it has 1000 bytes"):
        Budget("it", 1000).charge(FREE + 1001)
