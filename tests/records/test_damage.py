"""What is whole of a damaged log comes back, counted by the plain `mcap` library; what is missing is said."""

import io
import re

import numpy as np
import pytest
from mcap.writer import Writer
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_records.mcap.mcap_file import McapFile

from tests.records import damage

SIGNALS = {"force": {"topic": "/ft/wrench", "field": "wrench.force.z", "unit": "N"}}


@pytest.fixture(scope="module")
def logs():
    """Bytes and chunks of a log of 900 messages, by the way it was written."""
    raws = {style: damage.write(style, count=600, chunk=2048) for style in damage.WRITERS}
    return {style: (raw, list(damage.chunks(raw))) for style, raw in raws.items()}


@pytest.mark.parametrize("style", damage.WRITERS)
@pytest.mark.parametrize("kind", damage.KINDS, ids=lambda kind: kind.__name__)
def test_every_message_of_a_whole_chunk_comes_back(logs, tmp_path, kind, style):
    raw, written = logs[style]
    for seed in (1, 2):
        damaged = kind(raw, np.random.default_rng(seed))
        bad, good = tmp_path / f"{seed}.mcap", tmp_path / f"good{seed}.mcap"
        bad.write_bytes(damaged.raw)
        expected = damage.whole(damaged, written)
        McapReplay.recover(bad, good)
        found = damage.messages(good)
        assert not expected - found
        assert not found - sum((messages for _, _, messages in written), start=type(expected)())


def test_what_is_missing_is_said_with_its_place(logs, tmp_path):
    """By the statistics where they are there; else by the rates of what is left, with the missing end apart."""
    raw, written = logs["zstd"]
    begin, end, inside = written[10]
    damaged = raw[: begin + 60] + bytes(20) + raw[begin + 80 :]
    path = tmp_path / "bad.mcap"
    path.write_bytes(damaged)
    with pytest.raises(LogError, match=r"accept_cut = true reads the undamaged part"):
        _read(path, accept_cut=False)
    force, warning = _read(path, accept_cut=True)
    assert len(force) == 600 - sum(n for (topic, *_), n in inside.items() if topic == "/ft/wrench")
    assert f"bytes {begin} to {end} (between " in warning
    assert warning.count("bytes ") == 1  # and nothing of the end, which is whole
    assert f"{inside.total()} of 900 messages are missing, by the log's own statistics" in warning
    times = sorted({logged for _, logged, _, _ in inside})
    said = [float(t) for t in re.search(r"between ([\d.]+) s and ([\d.]+) s", warning).groups()]
    assert said == pytest.approx([(times[0] - 10**9) / 1e9 - 1e-3, (times[-1] - 10**9) / 1e9 + 1e-3], abs=1.1e-3)
    path.write_bytes(damaged[: written[-1][0]])
    warning = _read(path, accept_cut=True)[1]
    about = int(re.search(r"about (\d+) messages are missing", warning)[1])
    assert about == pytest.approx(inside.total(), abs=3)
    assert "everything after that is lost" in warning


def _read(path, accept_cut):
    device = McapReplay.model_validate({"file": path, "signals": SIGNALS, "accept_cut": accept_cut})
    with device.connect(0) as link:
        batches = list(link.batches())
    return np.concatenate([batch.values for batch in batches])[:, 0], "; ".join(device.warnings)


def test_a_window_of_a_damaged_log(logs, tmp_path):
    raw, written = logs["lz4"]
    begin, _, inside = written[10]
    (tmp_path / "bad.mcap").write_bytes(raw[: begin + 60] + bytes(20) + raw[begin + 80 :])
    device = {"file": tmp_path / "bad.mcap", "signals": SIGNALS, "accept_cut": True, "begin": "0.1 s", "end": "0.5 s"}
    with McapReplay.model_validate(device).connect(0) as link:
        count = sum(len(batch.time) for batch in link.batches())
    lost = sum(topic == "/ft/wrench" and 1.1e9 <= logged < 1.5e9 for topic, logged, _, _ in inside)
    assert count == 400 - lost


@pytest.mark.parametrize("chunked", [False, True])
def test_the_checksum_over_all_data_is_compared(tmp_path, chunked):
    """A message outside of chunks, and an index beside one, have no other checksum."""
    file = io.BytesIO()
    writer = Writer(file, use_chunking=chunked, enable_data_crcs=True)
    writer.start()
    channel = writer.register_channel("/x", "json", 0)
    for i in range(50):
        writer.add_message(channel, i, b'{"a": 111}', i)
    writer.finish()
    raw = bytearray(file.getvalue())
    at = next(begin + 20 for kind, begin, _ in damage.top(bytes(raw)) if kind == (7 if chunked else 5))
    raw[at + (0 if chunked else 16)] ^= 1
    path = tmp_path / "bad.mcap"
    path.write_bytes(raw)
    with pytest.raises(LogError, match="the checksum of its data is wrong"):
        list(McapFile(path).blocks({"/x"}))
    log = McapFile(path, accept_cut=True)
    assert sum(len(messages) for _, messages in log.blocks({"/x"})) == 50
    assert "the checksum of its data is wrong" in log.trouble
    assert ("50 messages carry no checksum" in log.trouble) == (not chunked)


def test_a_chunk_that_is_there_twice_is_read_once(logs, tmp_path):
    raw, written = logs["zstd"]
    begin, end, _ = written[4]
    path = tmp_path / "bad.mcap"
    path.write_bytes(raw[:end] + b"\xff" + raw[begin:end] + raw[end:])
    McapReplay.recover(path, tmp_path / "good.mcap")
    assert max(damage.messages(tmp_path / "good.mcap").values()) == 1


def test_definitions_of_a_damaged_chunk_serve_where_there_are_no_others(logs, tmp_path):
    """The first chunk defines the topics, and is damaged behind them; the summary is gone."""
    raw, written = logs["plain"]
    _, end, inside = written[0]
    bad = bytearray(raw[: written[20][1]])
    bad[end - 40] ^= 1
    (tmp_path / "bad.mcap").write_bytes(bad)
    said = McapReplay.recover(tmp_path / "bad.mcap", tmp_path / "good.mcap")
    assert "the definition of /arm/wrench, /ft/wrench comes from a chunk that is damaged" in said
    expected = sum((messages for _, _, messages in written[1:21]), start=type(inside)())
    assert damage.messages(tmp_path / "good.mcap") == expected


def test_a_search_that_finds_only_false_chunks_ends(tmp_path):
    """Ten thousand heads of chunks, each of which claims all the rest of the file."""
    import struct
    import time

    head = 9 + 40
    count = 10_000
    body = bytearray()
    for i in range(count):
        left = (count - i) * head
        body += b"\x06" + struct.pack("<QQQQII", left - 9, 0, 0, left - head, 1, 0) + struct.pack("<Q", left - head)
    path = tmp_path / "bad.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(body))
    began = time.process_time()
    with pytest.raises(LogError, match=r"nothing in it is undamaged"):
        McapReplay.recover(path, tmp_path / "good.mcap")
    assert time.process_time() - began < 20.0
