"""Topics that are valid and seldom: several kinds of messages in one, a message of no bytes, thousands of them."""

import csv
import itertools
import resource
import struct

import numpy as np
import pytest
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_logs.commands.export import export

from tests.records.official import json_topic, log_of, numbers, ours, ros_topic

A, B, OTHER = "float64 x\nfloat64 y\n", "float64 y\nfloat64 x\n", "# in other words\nfloat64 x  # [m]\n\nfloat64 y\n"


@pytest.mark.parametrize(
    ("kinds", "names"),
    [
        ((("lab/msg/A", A), ("lab/msg/B", "uint8 n\n")), ("/t(A)", "/t(B)")),
        ((("lab/msg/A", A), ("lab/msg/A", B)), ("/t(A)", "/t(A-2)")),
        ((("lab/msg/A", A), ("lab/msg/A", OTHER)), ("/t", "/t")),
    ],
    ids=["two types", "two definitions of one type", "one definition in two words"],
)
def test_a_topic_of_several_kinds_is_a_topic_for_each(tmp_path, kinds, names):
    def build(writer):
        for i, (kind, text) in enumerate(kinds):
            size = 16 if "x" in text else 1
            ros_topic(writer, "/t", kind, text, [struct.pack("<dd", 1 + i, k)[:size] for k in range(10)])
        json_topic(writer, "/beside", [{"x": i} for i in range(5)])

    path = log_of(tmp_path / "log.mcap", build)
    found = ours(path)
    assert set(found) == {*names, "/beside"}
    with path.open("rb") as file:
        messages = NonSeekingReader(file, decoder_factories=[Ros2Decoder()]).iter_decoded_messages(
            log_time_order=False, topics=["/t"]
        )
        rows = [(names[channel.id - 1], dict(numbers(message))) for _, channel, _, message in messages]
    for name in set(names):
        columns, _, values = found[name]
        assert [dict(zip(columns, row, strict=True)) for row in values] == [row for other, row in rows if other == name]
    counts = {entry.name: entry.messages for entry in McapReplay.survey(path).topics}
    assert counts == {**{name: 10 * names.count(name) for name in names}, "/beside": 5}


def test_a_kind_of_a_topic_is_read_under_its_own_name(tmp_path):
    def build(writer):
        ros_topic(writer, "/t", "lab/msg/A", A, [struct.pack("<dd", i, 9) for i in range(10)])
        ros_topic(writer, "/t", "lab/msg/B", "float64 z\n", [struct.pack("<d", -i) for i in range(10)])

    path = log_of(tmp_path / "log.mcap", build)
    for topic, field, sign in (("/t(A)", "x", 1), ("/t(B)", "z", -1)):
        signals = {"force": {"topic": topic, "field": field, "unit": "N"}}
        with McapReplay.model_validate({"file": path, "signals": signals}).connect(0) as link:
            read = np.concatenate([batch.values[:, 0] for batch in link.batches()])
        assert read.tolist() == [sign * i for i in range(10)]
    with pytest.raises(LogError, match=r"topic '/t' of 'force' is not in the log \(there are: /t\(A\), /t\(B\)\)"):
        _ = McapReplay.model_validate({"file": path, "signals": {"force": {**signals["force"], "topic": "/t"}}}).streams


@pytest.mark.parametrize("place", [0, 150, 299])
@pytest.mark.parametrize("encoding", ["json", "cdr"])
def test_a_message_of_no_bytes_hides_no_others(tmp_path, encoding, place):
    def build(writer):
        if encoding == "json":
            json_topic(writer, "/t", [b"" if i == place else {"x": i} for i in range(300)])
        else:
            channel = writer.register_channel("/t", "cdr", writer.register_schema("lab/msg/A", "ros2msg", b"float64 x"))
            for i in range(300):
                writer.add_message(channel, i, b"" if i == place else b"\0\1\0\0" + struct.pack("<d", i), i)

    path, notes = log_of(tmp_path / "log.mcap", build), []
    _, _, values = ours(path, notes)["/t"]
    assert [row[0] for row in values] == [i for i in range(300) if i != place]
    assert len(notes) == 1
    assert notes[0].startswith("/t: 1 of 300 messages were left out: a message ")
    (topic,) = McapReplay.survey(path).topics
    assert (topic.messages, topic.numbers[0].high) == (300, 299 - (place == 299))
    assert topic.note.startswith("1 of 300 messages were left out: a message ")


@pytest.mark.slow
def test_three_thousand_topics_need_no_more_open_files_than_one(tmp_path):
    def build(writer):
        schema = writer.register_schema("lab/msg/A", "ros2msg", b"float64 x\nstring s\n")
        channels = [writer.register_channel(f"/t{k}", "cdr", schema) for k in range(3000)]
        for i, (k, channel) in itertools.product(range(2), enumerate(channels)):
            writer.add_message(channel, i, b"\0\1\0\0" + struct.pack("<dI", i * k, 2) + b"a\0", i)

    path = log_of(tmp_path / "log.mcap", build)
    few, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, most))
    try:
        export(path, tmp_path / "all.csv")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (few, most))
    with (tmp_path / "all.csv").open() as file:
        head, *rows = csv.reader(file)
    assert [dict(zip(head, row, strict=True))[f"/t{k}:x"] for row, k in zip(rows, (1, 2999), strict=True)] == [
        "0.0",
        "2999.0",
    ]
    assert len(head) == 2 + 2 * 3000
