"""MCAP files of any writer: what comes out is what other readers find, or a refusal in words."""

import json
import re
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from mcap.writer import CompressionType, IndexType, Writer
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import WRENCH
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.definitions import parse_definitions
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Topic

from tests.records.bags import wrench_message

COUNT = 300
STEP = 1_000_000  # [ns]


def write_log(path, count=COUNT, **options):
    """A log of two topics: a wrench whose frame changes once, and JSON."""
    options = {"chunk_size": 4096, **options}
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(WRENCH.name, "ros2msg", WRENCH.definition.encode())
        wrench = writer.register_channel("/ft/wrench", "cdr", schema)
        for i in range(count):
            if i == count // 2:
                words = writer.register_channel("/state", "json", 0)
            stamp = 10**9 + i * STEP
            frame = "tool0" if i < count // 3 else "ft_sensor0_wrench"
            writer.add_message(wrench, stamp + 50_000, wrench_message(stamp, frame, [i, -i, i * 0.5, 0, 0, 1]), stamp)
            if i >= count // 2:
                text = json.dumps({"pose": {"z": i / 8}, "timestamp": {"sec": 1, "nsec": i}})
                writer.add_message(words, stamp, text.encode(), stamp)
        writer.finish()
    return path


def test_the_page_reads_a_log_in_three_lines(root, tmp_path):
    """The lines stand in docs/read-a-log.md; no pipeline, engine or kit is loaded for them."""
    write_log(tmp_path / "log.mcap", COUNT)
    (block,) = re.findall(r"```python\n(.*?)```", (root / "docs" / "read-a-log.md").read_text(), re.DOTALL)
    block += "import sys\nprint('loaded:', *{name.partition('.')[0] for name in sys.modules if 'palpate' in name})"
    done = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "/ft/wrench ('header.stamp.sec', 'header.stamp.nanosec', 'wrench.force.x'" in done.stdout
    assert set(done.stdout.rpartition("loaded:")[2].split()) == {"palpate", "palpate_records"}


SIGNALS = {
    "force": {"topic": "/ft/wrench", "field": "wrench.force.z", "unit": "N"},
    "z": {"topic": "/state", "field": "pose.z", "unit": "mm"},
}


def read(path, **keys):
    """Time and values by stream."""
    device = McapReplay.model_validate({"file": path, "signals": SIGNALS, **keys})
    with device.connect(0) as link:
        batches = list(link.batches())
    names = [stream.name for stream in device.streams]
    found = {name: [b for b in batches if b.stream == name] for name in names}
    return {
        name: (np.concatenate([b.time for b in blocks]), np.concatenate([b.values for b in blocks])[:, 0])
        for name, blocks in found.items()
        if blocks
    }


WRITERS = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "plain": {"compression": CompressionType.NONE},
    "one chunk": {"chunk_size": 1 << 24},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE},
    "no checksums": {"enable_crcs": False},
    "no statistics": {"use_statistics": False},
    "no summary": {
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_summary_offsets": False,
        "index_types": IndexType.NONE,
    },
    "definitions in the data only": {"repeat_channels": False, "repeat_schemas": False},
    "data checksum": {"enable_data_crcs": True, "use_chunking": False},
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_way_to_write_a_file_reads_the_same(tmp_path, name):
    found = read(write_log(tmp_path / "log.mcap", **WRITERS[name]))
    time, force = found["wrench"]
    np.testing.assert_array_equal(force, np.arange(COUNT) * 0.5)
    np.testing.assert_array_equal(time, 10**9 + np.arange(COUNT) * STEP)
    time, height = found["state"]
    np.testing.assert_array_equal(height, np.arange(COUNT // 2, COUNT) / 8 * 1e-3)
    np.testing.assert_array_equal(time, 10**9 + np.arange(COUNT // 2, COUNT))


@pytest.mark.parametrize("name", WRITERS)
def test_a_window_of_time(tmp_path, name):
    path = write_log(tmp_path / "log.mcap", **WRITERS[name])
    time, _ = read(path, begin="100 ms", end="0.2 s", signals={"force": SIGNALS["force"]})["wrench"]
    # The first message is logged at 1.00005 s.
    np.testing.assert_array_equal(time, 10**9 + np.arange(100, 200) * STEP)


@pytest.mark.parametrize(("clock", "late"), [("stamp", 0), ("publish", 0), ("log", 50_000)])
def test_the_source_of_time(tmp_path, clock, late):
    path = write_log(tmp_path / "log.mcap")
    time, _ = read(path, time=clock, signals={"force": SIGNALS["force"]})["wrench"]
    assert (time[0] - 10**9, len(time)) == (late, COUNT)


def test_a_log_is_recognised_by_its_name(tmp_path):
    (tmp_path / "folder.mcap").mkdir()
    for name in ("a.mcap", "a.csv", "mcap"):
        (tmp_path / name).write_bytes(b"")
    names = ("a.mcap", "a.csv", "mcap", "folder.mcap", "none.mcap")
    assert [name for name in names if McapReplay.recognises(tmp_path / name)] == ["a.mcap"]


def test_stamps_that_do_not_move_are_refused(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(WRENCH.name, "ros2msg", WRENCH.definition.encode())
        channel = writer.register_channel("/ft/wrench", "cdr", schema)
        for i in range(20):
            writer.add_message(channel, i, wrench_message(0, "f", range(6)), i)
        writer.finish()
    keys = {"signals": {"force": SIGNALS["force"]}}
    with pytest.raises(LogError, match=r'stamps of /ft/wrench do not move; set time = "log"'):
        read(path, **keys)
    assert len(read(path, time="log", **keys)["wrench"][0]) == 20


def leaves(item, path=""):
    """Numbers of a decoded message by path."""
    if hasattr(item, "__slots__") or hasattr(item, "__dict__"):
        names = getattr(item, "__slots__", None) or vars(item)
        for name in names:
            yield from leaves(getattr(item, name), f"{path}.{name}" if path else name)
    elif isinstance(item, bytes | bytearray | memoryview):
        yield from ((f"{path}[{i}]", float(v)) for i, v in enumerate(bytes(item)))
    elif isinstance(item, str):
        return
    elif isinstance(item, bool | int | float):
        yield path, float(item)
    elif hasattr(item, "__len__"):
        for i, inner in enumerate(item):
            yield from leaves(inner, f"{path}[{i}]")


@pytest.mark.slow
def test_every_number_of_the_real_files_is_that_of_another_reader(shared):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    compared = 0
    for path in sorted((shared / "mcap").glob("*.mcap")):
        log = McapFile(path)
        blocks = {name: [] for name in log.topics}
        for name, messages in log.blocks(set(log.topics)):
            blocks[name].append(messages)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            theirs = {}
            for _, channel, _, decoded in reader.iter_decoded_messages(log_time_order=False):
                theirs.setdefault(channel.topic, []).append(decoded)
        assert theirs.keys() == {name for name, found in blocks.items() if found}
        for name, decoded in theirs.items():
            assert sum(map(len, blocks[name])) == len(decoded)
            decoder = decoder_of(log.topics[name])
            i = 0
            for messages in blocks[name]:
                for row in range(len(messages)):
                    expected = dict(leaves(decoded[i]))
                    readings = [FieldReading.parse(text) for text in expected]
                    table = decoder.read(messages[np.array([row])], readings)
                    np.testing.assert_array_equal(table.values[0], list(expected.values()), err_msg=name)
                    compared += len(expected)
                    i += 1
    assert compared > 3500


def test_protobuf_with_its_descriptor(tmp_path):
    from google.protobuf import descriptor_pb2, timestamp_pb2
    from google.protobuf.message_factory import GetMessages

    file = descriptor_pb2.FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    stamp = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    message = file.message_type.add(name="Press")
    message.field.add(name="timestamp", number=1, type=11, label=1, type_name=".google.protobuf.Timestamp")
    message.field.add(name="force", number=2, type=1, label=1)
    message.field.add(name="pose", number=3, type=1, label=3)
    press = GetMessages([stamp, file])["lab.Press"]
    schema = descriptor_pb2.FileDescriptorSet(file=[stamp, file]).SerializeToString()
    path = tmp_path / "log.mcap"
    with path.open("wb") as opened:
        writer = Writer(opened)
        writer.start()
        channel = writer.register_channel("/press", "protobuf", writer.register_schema("lab.Press", "protobuf", schema))
        for i in range(20):
            item = press(force=float(i), pose=[1.0, i])  # a force of 0 is left out of the message
            item.timestamp.FromNanoseconds(5 * 10**9 + i)
            writer.add_message(channel, i, item.SerializeToString(), i)
        writer.finish()
    time, force = read(path, signals={"f": {"topic": "/press", "field": "force", "unit": "N"}})["press"]
    assert (time - 5 * 10**9).tolist() == force.tolist() == list(range(20))
    pose = read(path, signals={"z": {"topic": "/press", "field": "pose", "index": 1, "unit": "m"}})["press"][1]
    assert pose.tolist() == list(range(20))


# Damage: whatever the bytes, either the numbers are those of the whole log, or there is one message in words.


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """The bytes of a whole log by the way it was written, and a folder for damaged ones."""
    folder = tmp_path_factory.mktemp("logs")
    names = ("zstd", "lz4", "plain", "no index", "one chunk")
    return folder, {name: write_log(folder / "log.mcap", count=120, **WRITERS[name]).read_bytes() for name in names}


def outcome(folder, raw, accept_cut):
    path = folder / "damaged.mcap"
    path.write_bytes(raw)
    try:
        return read(path, accept_cut=accept_cut)
    except LogError as refusal:
        words = str(refusal)
    assert "damaged.mcap" in words
    return None


def only_true_numbers(found, strict):
    """Every number stands where it belongs; with `strict`, none is missing."""
    for name, (time, values) in (found or {}).items():
        i = (time - 10**9) // (STEP if name == "wrench" else 1)
        np.testing.assert_array_equal(values, i * 0.5 if name == "wrench" else i / 8 * 1e-3)
        assert (np.diff(i) == 1).all() or not strict
        assert len(i) == (120 if name == "wrench" else 60) or not strict


FUZZ = settings(max_examples=120, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@pytest.mark.gate
@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_flipped_bits_never_pass_as_data(logs, data):
    folder, files = logs
    raw = bytearray(files[data.draw(st.sampled_from(sorted(files)))])
    for _ in range(data.draw(st.integers(1, 3))):
        raw[data.draw(st.integers(0, len(raw) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    accept = data.draw(st.booleans())
    only_true_numbers(outcome(folder, raw, accept), strict=not accept)


@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_a_log_cut_anywhere_gives_what_is_whole(logs, data):
    folder, files = logs
    raw = files[data.draw(st.sampled_from(sorted(files)))]
    raw = raw[: data.draw(st.integers(0, len(raw) - 1))]
    assert outcome(folder, raw, accept_cut=False) is None
    only_true_numbers(outcome(folder, raw, accept_cut=True), strict=False)


def boundaries(raw):
    """Where each top-level record begins."""
    position = 8
    while position < len(raw) - 8:
        yield position
        position += 9 + struct.unpack_from("<Q", raw, position + 1)[0]


@pytest.mark.parametrize("name", ["zstd", "plain"])
def test_a_log_cut_between_any_two_records(logs, name):
    folder, files = logs
    raw = files[name]
    whole = []
    for cut in boundaries(raw):
        found = outcome(folder, raw[:cut], accept_cut=True)
        only_true_numbers(found, strict=False)
        whole.append(len(found["wrench"][0]) if found and "wrench" in found else 0)
    assert whole == sorted(whole)
    assert whole[-1] == 120


@pytest.mark.parametrize("length", [0, 1, 2**31, 2**32, 2**63 - 1, 2**63, 2**64 - 1])
@pytest.mark.parametrize("name", ["zstd", "plain"])
def test_wrong_lengths_of_every_record(logs, name, length):
    folder, files = logs
    raw = files[name]
    for begin in list(boundaries(raw))[::3]:
        damaged = raw[: begin + 1] + struct.pack("<Q", length) + raw[begin + 9 :]
        only_true_numbers(outcome(folder, damaged, accept_cut=True), strict=False)
        only_true_numbers(outcome(folder, damaged, accept_cut=False), strict=True)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "", "brotli"])
@pytest.mark.parametrize("claimed", [10, 10**11, 2**63, 2**64 - 1])
def test_a_chunk_that_claims_more_than_it_has(tmp_path, compression, claimed):
    """A small chunk of zeros that claims 100 GB takes no memory."""
    import resource

    import lz4.frame
    import zstandard

    zeros = b"\0" * (1 << 22)
    packed = {"zstd": zstandard.compress(zeros), "lz4": lz4.frame.compress(zeros)}.get(compression, zeros[:100])
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 1, claimed, zlib.crc32(zeros), len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    header = b"\x01" + struct.pack("<QII", 8, 0, 0)
    (tmp_path / "bomb.mcap").write_bytes(b"\x89MCAP0\r\n" + header + b"\x06" + struct.pack("<Q", len(body)) + body)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogError, match=r"bomb\.mcap"):
        _ = McapReplay(file=tmp_path / "bomb.mcap", accept_cut=True).streams
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("float64", "is not a field"),
        ("\x00\xff", "is not a field"),
        ("Loop next\n" + "=" * 80 + "\nMSG: a/Loop\nLoop next", "a/Loop contains itself"),
        ("B b\n" + "=" * 80 + "\nMSG: a/B\nC c\n" + "=" * 80 + "\nMSG: a/C\nB b", "a/B contains itself"),
        ("Nowhere x", "names a/Nowhere, which the log does not define"),
        ("float64 x\n" + "=" * 80 + "\nfloat64 y", "a part of it has no name"),
        ("float64 x\n" * 200_000, "is damage"),
    ],
)
def test_definitions_that_are_damaged(text, words):
    with pytest.raises(LogError, match=re.escape(words)):
        parse_definitions("a/msg/Loop", text)


@FUZZ
@given(text=st.text(alphabet="abcfloat64 []<=/\n#\"'MSG:std_msgs/Header", max_size=200))
def test_any_text_is_a_definition_or_refused(text):
    try:
        definitions = parse_definitions("a/b", text)
    except LogError:
        return
    assert "a/b" in definitions


@FUZZ
@given(payload=st.binary(max_size=120))
@pytest.mark.parametrize("kind", ["sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", WRENCH.name])
def test_any_bytes_are_a_message_or_refused(kind, payload):
    from palpate_records.messages.topics import Messages

    messages = Messages.joined([b"\0\1\0\0" + payload], np.zeros(1, np.int64), np.zeros(1, np.int64))
    try:
        table = decoder_of(Topic("/t", kind)).read(
            messages, [FieldReading("position", 0), FieldReading("wrench.force.z")]
        )
    except LogError:
        return
    assert table.values.shape == (1, 2)


def test_a_sequence_that_claims_four_billion_elements():
    body = b"\0\1\0\0" + struct.pack("<III", 0, 0, 2**32 - 1) + b"\0" * 40
    with pytest.raises(LogError, match="ends before its fields do"):
        decoder_of(Topic("/t", "std_msgs/msg/Float64MultiArray")).fields(body)
    with pytest.raises(LogError, match="ends before its fields do"):
        decoder_of(Topic("/t", "tf2_msgs/msg/TFMessage")).fields(b"\0\1\0\0" + struct.pack("<I", 2**32 - 1))
