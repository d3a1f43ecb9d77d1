"""What `palpate log recover` writes: chunks as they were, an index of them, and nothing that readers stumble over."""

import io
import struct
import zlib
from collections import Counter

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Header, Message, Metadata, Schema
from palpate import LogError, OutputError
from palpate_devices.mcap_replay import McapReplay
from palpate_records.mcap.mcap_file import McapFile

from tests.records import damage

# Older releases of `mcap` know only `start_time` and `end_time`.
pytestmark = pytest.mark.filterwarnings("ignore:.*_time is deprecated:DeprecationWarning")

MAGIC = b"\x89MCAP0\r\n"


def packed(*records):
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def chunk(*records, crc=True):
    data = packed(*records)
    return packed(Chunk("", data, 0, 0, zlib.crc32(data) if crc else 0, len(data)))


def log(path, *parts):
    end = packed(DataEnd(0), Footer(0, 0, 0))
    path.write_bytes(MAGIC + packed(Header("", "")) + b"".join(parts) + end + MAGIC)
    return path


def message(channel, stamp):
    return Message(channel, stamp, b"%d" % stamp, stamp, 0)


def stamps(path, **window):
    """Of each topic, by the plain reader through the index."""
    with path.open("rb") as file:
        found = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file, True).iter_messages(**window)]
    assert all(data == b"%d" % stamp for _, stamp, data in found)
    return {topic: [stamp for name, stamp, _ in found if name == topic] for topic, _, _ in found}


@pytest.mark.parametrize("style", damage.WRITERS)
def test_a_whole_chunk_is_copied_and_found_by_its_topic_and_time(style, tmp_path):
    raw = damage.write(style, 600)
    written = list(damage.chunks(raw))
    bad = bytearray(raw)
    bad[written[3][1] - 30] ^= 4
    (tmp_path / "bad.mcap").write_bytes(bad)
    McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")
    good = (tmp_path / "good.mcap").read_bytes()
    for number, (begin, end, _) in enumerate(written):
        assert (raw[begin + 60 : end] in good) == (number != 3)  # a chunk's head is 50 bytes long
    expected = sum((found for i, (_, _, found) in enumerate(written) if i != 3), start=Counter())
    times = sorted(logged for _, logged, _, _ in expected)
    window = {"start_time": times[200], "end_time": times[500], "topics": ["/arm/wrench"]}
    with (tmp_path / "good.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = Counter((c.topic, m.log_time, m.sequence, m.data) for _, c, m in reader.iter_messages(**window))
        statistics = reader.get_summary().statistics
    inside = Counter({m: n for m, n in expected.items() if m[0] == "/arm/wrench" and times[200] <= m[1] < times[500]})
    assert found == inside
    assert (statistics.message_count, statistics.message_start_time) == (expected.total(), times[0])
    assert statistics.message_end_time == times[-1]
    again = McapFile(tmp_path / "good.mcap")
    assert sum(len(messages) for _, messages in again.blocks(set(again.topics))) == expected.total()
    assert again.trouble is None


def test_what_a_run_carries_stands_ahead_of_its_messages(tmp_path):
    """There a replay looks for it; one whose checksum is wrong comes from beside the log, a foreign log's not."""
    carried = Attachment(0, 0, "pipeline.toml", "", b"[run]"), Metadata("palpate", {"seed": "3"})
    for facts, flip, expected in (
        ({"palpate": "{}"}, 0, {"pipeline.toml": "[run]"}),
        ({"palpate": "{}"}, 1, {"pipeline.toml": "beside"}),
        ({}, 1, {}),
    ):
        channel = Channel(1, "/a", "json", facts, 0)
        raw = bytearray(log(tmp_path / "bad.mcap", packed(channel, *carried), chunk(message(1, 1))).read_bytes())
        raw[raw.index(b"[run]")] ^= flip
        (tmp_path / "bad.mcap").write_bytes(raw[:-40])
        (tmp_path / "good.mcap").unlink(missing_ok=True)
        said = McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap", {"pipeline.toml": "beside"})
        found = McapReplay.attached(tmp_path / "good.mcap")
        assert (found.documents, found.facts) == (expected, {"seed": "3"})
        assert ("with pipeline.toml from next to" in said) == ("beside" in expected.values())
        assert stamps(tmp_path / "good.mcap") == {"/a": [1]}


def test_a_chunk_with_messages_that_nothing_defines_is_written_without_them(tmp_path):
    schema, channel = Schema(7, b"float64 data", "ros2msg", "std_msgs/msg/Float64"), Channel(3, "/a", "cdr", {}, 7)
    both = [message(3 + i % 2, i) for i in range(10)]
    bad = log(tmp_path / "bad.mcap", packed(schema, channel), chunk(message(3, 100)), chunk(*both))
    said = McapReplay.recover(bad, tmp_path / "good.mcap")
    assert stamps(tmp_path / "good.mcap") == {"/a": [0, 2, 4, 6, 8, 100]}
    assert "5 undamaged messages belong to topics whose definitions are lost" in said


def test_a_chunk_that_defines_a_topic_otherwise_is_written_without_that(tmp_path):
    first, second = (chunk(Channel(1, name, "json", {}, 0), message(1, at)) for name, at in (("/a", 1), ("/b", 2)))
    McapReplay.recover(log(tmp_path / "bad.mcap", first, second, chunk(message(1, 3))), tmp_path / "good.mcap")
    assert stamps(tmp_path / "good.mcap") == {"/a": [1, 2, 3]}
    assert b"/b" not in (tmp_path / "good.mcap").read_bytes()


def test_a_schema_that_is_lost_is_not_asked_for(tmp_path):
    """A topic refers to it, and a reader would refuse the log."""
    bad = log(tmp_path / "bad.mcap", chunk(Channel(1, "/a", "json", {}, 9), message(1, 1)))
    McapReplay.recover(bad, tmp_path / "good.mcap")
    assert stamps(tmp_path / "good.mcap") == {"/a": [1]}


def test_messages_without_a_checksum_get_one(tmp_path):
    """Within a chunk that has none, and outside of chunks."""
    channel = Channel(1, "/a", "json", {}, 0)
    parts = packed(channel, message(1, 1), message(1, 2)), chunk(message(1, 3), crc=False), packed(message(1, 4))
    said = McapReplay.recover(log(tmp_path / "bad.mcap", *parts), tmp_path / "good.mcap")
    assert "4 messages" in said
    assert stamps(tmp_path / "good.mcap") == {"/a": [1, 2, 3, 4]}
    again = McapFile(tmp_path / "good.mcap")
    assert [len(messages) for _, messages in again.blocks({"/a"})] == [4]
    assert again.unchecked == 0


def test_messages_behind_a_damaged_one_are_found_where_there_are_no_chunks(tmp_path):
    channel = Channel(1, "/a", "json", {}, 0)
    whole = log(tmp_path / "bad.mcap", packed(channel, *(message(1, 1000 + i) for i in range(40)))).read_bytes()
    size = len(packed(message(1, 1000)))
    begin = whole.index(packed(message(1, 1020)))
    (tmp_path / "bad.mcap").write_bytes(whole[:begin] + b"\xff" * 20 + whole[begin + 20 :])
    McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")
    found = stamps(tmp_path / "good.mcap")["/a"]
    assert set(found) <= {1000 + i for i in range(40)} - {1020}
    assert len(found) >= 38  # the one before it is not followed by a record
    assert size == 31 + 4


def test_messages_of_a_chunk_whose_checksum_is_wrong_are_not_taken_for_loose_ones(tmp_path):
    """It is not compressed, and nothing before it can be read."""
    messages = [message(1, 1000 + i) for i in range(40)]
    made = chunk(*messages[:20], Channel(1, "/a", "json", {}, 0), *messages[20:])
    raw = bytearray(log(tmp_path / "bad.mcap", made).read_bytes())
    raw[len(MAGIC) + 1] = 0xFF  # the length of the first record
    raw[raw.index(b"1005")] ^= 1
    (tmp_path / "bad.mcap").write_bytes(raw)
    with pytest.raises(LogError, match="nothing in it is undamaged"):
        McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")


def test_times_in_a_chunks_head_come_from_its_messages(tmp_path):
    """No checksum covers them, and readers leave out chunks by them."""
    raw = log(tmp_path / "bad.mcap", chunk(Channel(1, "/a", "json", {}, 0), message(1, 5), message(1, 9))).read_bytes()
    at = next(begin for kind, begin, _ in damage.top(raw) if kind == 6)
    assert struct.unpack_from("<QQ", raw, at + 9) == (0, 0)
    McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")
    good = io.BytesIO((tmp_path / "good.mcap").read_bytes())
    found = make_reader(good).get_summary().chunk_indexes[0]
    assert (found.message_start_time, found.message_end_time) == (5, 9)
    assert struct.unpack_from("<QQ", good.getvalue(), found.chunk_start_offset + 9) == (5, 9)


def test_nothing_is_left_where_the_new_log_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "bad.mcap").write_bytes(damage.write("zstd", 300)[:-50])

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match=r"good\.mcap: cannot write: No space left on device"):
        McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mcap"]
    with pytest.raises(OutputError, match=r"none/good\.mcap: cannot write"):
        McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "none" / "good.mcap")


@pytest.mark.slow
def test_many_small_chunks_and_topics(tmp_path):
    """As a live recording has them: read together, written one by one."""
    rng = np.random.default_rng(1)
    channels = [Channel(i, f"/{i}", "json", {}, 0) for i in range(20)]
    of = rng.integers(0, 20, 2000).tolist()
    chunks = [chunk(*(message(of[i], i) for i in range(a, a + 10))) for a in range(0, 2000, 10)]
    McapReplay.recover(log(tmp_path / "bad.mcap", packed(*channels), *chunks), tmp_path / "good.mcap")
    expected = {f"/{i}": [at for at in range(2000) if of[at] == i] for i in range(20)}
    assert stamps(tmp_path / "good.mcap") == expected
    assert stamps(tmp_path / "good.mcap", topics=["/7"], start_time=600, end_time=900) == {
        "/7": [at for at in expected["/7"] if 600 <= at < 900]
    }


def test_the_words_never_run_backwards(tmp_path):
    """Chunks of which the later one was logged first, on both sides of one that is damaged."""
    defined = [Schema(1, b"", "", ""), Channel(1, "/a", "json", {}, 0)]
    late, lost, early = ([message(1, 10**9 * (begin + i)) for i in range(3)] for begin in (9, 6, 3))
    bad = bytearray(chunk(*lost))
    bad[-5] ^= 1
    path = log(tmp_path / "log.mcap", chunk(*defined, *late), bytes(bad), chunk(*early))
    said = McapReplay.recover(path, tmp_path / "new.mcap")
    assert said.startswith("6 messages over 8.000 s are in ")
    assert "(between 0.000 s and 8.000 s): " in said
    assert stamps(tmp_path / "new.mcap", log_time_order=False) == {"/a": [10**9 * n for n in (9, 10, 11, 3, 4, 5)]}
