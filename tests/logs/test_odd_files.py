"""Files that nobody expects: pipes, bombs, endless views, long names; and numbers that are none."""

import fcntl
import gzip
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.logs.log_link import file_facts
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_records import temporary_folders as scratch_folders
from palpate_records.bags.bag_folder import Bag, bag_files
from palpate_records.bags.sqlite_bag import SqliteBag
from palpate_records.log_files import regular
from palpate_records.mcap.mcap_file import McapFile
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.temporary_folders import scratch

from tests.records.bags import array_message, write_bag

CORPUS = Path(__file__).parent / "corpus"
SIGNALS = {"z": {"topic": "/data", "field": "data", "index": 1, "unit": "m"}}


@pytest.mark.parametrize("opened", [McapFile, SqliteBag, Sheet.of, bag_files, lambda path: file_facts(path, [path])])
def test_what_is_no_regular_file_is_never_waited_for(tmp_path, opened):
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path / "pipe", "is not a regular file"),
        (Path("/dev/zero"), "is not a regular file"),
        (Path("/proc/self/mem"), "cannot be read|is not an MCAP log|the file is empty|is not a rosbag2|is not a CSV"),
        (tmp_path / ("n" * 300), "no file can have this name|no such file"),
    ):
        if path.name == "mem" and opened in (SqliteBag, bag_files):  # opened later
            continue
        with pytest.raises(LogError, match=words):
            opened(path)


def test_a_bag_of_memory_is_refused():
    with pytest.raises(LogError, match="cannot be read"):
        _ = SqliteBag(Path("/proc/self/mem")).topics


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("endless_view.db3", "messages is not a table in it"),
        ("topics_are_a_view.db3", "topics is not a table in it"),
        ("bomb_that_begins_well.db3.zstd", "unpacks to more than 200 times its size"),
        ("bomb.db3.gz", "does not begin as it should"),
        ("damaged.db3.gz", "cannot be read"),
        ("damaged.csv.gz", "cannot be read"),
        ("schema_of_no_text.db3", "is damaged"),
    ],
)
def test_what_a_file_of_the_corpus_is_refused_for(name, words):
    began = time.process_time()
    with pytest.raises(LogError, match=words):
        recording_of(CORPUS / name).survey(CORPUS / name)
    assert time.process_time() - began < 5.0
    assert not list(Path(os.environ.get("TMPDIR", "/tmp")).glob(f"palpate-*/{name}"))


def test_names_of_no_text_are_shown_and_do_not_stop_the_others():
    (topic,) = Rosbag2Replay.survey(CORPUS / "name_of_no_text.db3").topics
    assert (topic.messages, topic.name[0]) == (200, "/")


@pytest.mark.parametrize("name", ["computed_column.db3", "index_of_words.db3"])
def test_a_bag_with_more_than_its_tables_is_recovered(tmp_path, name):
    said = Rosbag2Replay.recover(CORPUS / name, tmp_path / "good.db3")
    assert said.startswith("the bag was whole: 200 messages")
    with Rosbag2Replay.model_validate({"file": tmp_path / "good.db3", "signals": SIGNALS}).connect(0) as link:
        values = np.concatenate([batch.values[:, 0] for batch in link.batches()])
    np.testing.assert_array_equal(values, np.arange(200))
    if name == "index_of_words.db3":
        with closing(sqlite3.connect(tmp_path / "good.db3")) as database:
            assert database.execute("SELECT a, b, c FROM notes").fetchall() == [(1, 2, "12")]


def test_a_bag_that_fits_nowhere_is_not_unpacked(tmp_path, monkeypatch):
    import shutil

    raw = write_bag(tmp_path / "bag.db3", [("/data", "std_msgs/msg/Float64MultiArray", [(0, array_message([1.0]))])])
    (tmp_path / "bag.db3.gz").write_bytes(gzip.compress(raw.read_bytes()))
    usage = type(shutil.disk_usage(tmp_path))
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage(10**9, 10**9 - 2**28 - 100, 2**28 + 100))
    with pytest.raises(LogError, match="more than the 0 MiB that are free"):
        _ = SqliteBag(tmp_path / "bag.db3.gz").topics


def test_folders_that_a_kill_left_are_removed_by_the_next_and_no_others(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    words = (
        "import sys, tempfile, time\nfrom palpate_records.temporary_folders import scratch\n"
        f"tempfile.tempdir = {str(tmp_path)!r}\n"
        "with scratch() as folder:\n    (folder / 'bag.db3').write_bytes(b'x')\n    print('there', flush=True)\n"
        "    time.sleep(60)"
    )
    job = subprocess.Popen([sys.executable, "-c", words], stdout=subprocess.PIPE)
    assert job.stdout.readline() == b"there\n"
    (tmp_path / "palpate-of-somebody").mkdir()
    with scratch():
        assert len(list(tmp_path.glob("palpate-*/bag.db3"))) == 1  # its owner is at work
    job.send_signal(signal.SIGKILL)
    job.wait()
    job.stdout.close()
    with scratch() as folder:
        assert sorted(tmp_path.iterdir()) == sorted([folder, tmp_path / "palpate-of-somebody"])
    assert list(tmp_path.iterdir()) == [tmp_path / "palpate-of-somebody"]


def test_a_folder_that_another_process_removed_before_it_was_locked_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    lock, left = fcntl.flock, ["once"]

    def late(file, how):
        if how == fcntl.LOCK_EX and left:
            left.clear()
            scratch_folders._remove_abandoned(tmp_path, "palpate-")  # as another process would, in between
            assert list(tmp_path.iterdir()) == []
        lock(file, how)

    monkeypatch.setattr("fcntl.flock", late)
    with scratch() as folder:
        (folder / "bag.db3").write_bytes(b"x")
        assert list(tmp_path.iterdir()) == [folder]
    assert list(tmp_path.iterdir()) == []


def test_metadata_of_blank_lines_and_of_names_that_none_can_have(tmp_path):
    write_bag(tmp_path / "bag_0.db3", [("/data", "std_msgs/msg/Float64MultiArray", [(0, array_message([1.0]))])])
    began = time.process_time()
    (tmp_path / "metadata.yaml").write_text("\n" * 300_000 + "  relative_file_paths:\n    - bag_0.db3\n  x: 1\n")
    assert [file.name for file in Bag(tmp_path).files] == ["bag_0.db3"]
    assert time.process_time() - began < 2.0
    (tmp_path / "metadata.yaml").write_text("relative_file_paths: [bag_0.db3,\n  'bag_0.db3']\n")
    assert [file.name for file in Bag(tmp_path).files] == ["bag_0.db3", "bag_0.db3"]
    (tmp_path / "metadata.yaml").write_text(f"relative_file_paths:\n- {'n' * 3000}\n")
    with pytest.raises(LogError, match=r"lists nnn.*which is not there") as refusal:
        Bag(tmp_path)
    assert len(str(refusal.value)) < 500


def read(path, **keys):
    device = CsvReplay.model_validate({"file": path, **keys})
    with device.connect(0) as link:
        batches = list(link.batches())
    return device, np.concatenate([batch.values for batch in batches])


NAMED = {"time": {"column": 0, "unit": "s"}, "columns": {"force": {"column": 1, "unit": "N"}}}


def test_cells_that_are_no_numbers_and_lines_that_are_too_long():
    with pytest.raises(LogError, match=r"underscores\.csv:2: column 1 holds '1_5', which is not a number"):
        read(CORPUS / "underscores.csv", **NAMED)
    assert np.isnan(next(Sheet.of(CORPUS / "underscores.csv").blocks())[0, 1])
    with pytest.raises(LogError, match=r"one_cell_too_many\.csv:31: the line has 4 cells, the first one 3"):
        read(CORPUS / "one_cell_too_many.csv", **NAMED)


def test_a_comma_at_the_end_of_every_line_is_no_cell(tmp_path):
    (tmp_path / "a.csv").write_text("t,force\n" + "0.1,2,\n" * 5)
    assert len(read(tmp_path / "a.csv", **NAMED)[1]) == 5


def test_times_that_are_no_numbers_are_counted():
    device, values = read(CORPUS / "times_of_no_number.csv", **NAMED)
    left_out = len({i for i in range(100) if i % 5 == 0 or i % 7 == 0})
    assert len(values) == 100 - left_out
    assert device.warnings == (f"times_of_no_number.csv: {left_out} rows have no finite time, and were left out",)


def test_times_of_messages_that_are_no_numbers_are_counted(tmp_path):
    rows = [(i, array_message([np.nan if i % 4 == 0 else i / 100, i])) for i in range(100)]
    path = write_bag(tmp_path / "bag.db3", [("/data", "std_msgs/msg/Float64MultiArray", rows)])
    clock = {"field": "data", "index": 0, "unit": "s"}
    device = Rosbag2Replay.model_validate({"file": path, "signals": SIGNALS, "time": clock})
    for _ in range(2):
        with device.connect(0) as link:
            assert sum(len(batch.time) for batch in link.batches()) == 75
    assert device.warnings == ("bag.db3: 25 messages of /data have no finite time, and were left out",)


def test_a_spike_that_no_instrument_gives_is_an_invalid_reading():
    _, values = read(CORPUS / "spike.csv", **NAMED)
    assert np.flatnonzero(np.isnan(values[:, 0])).tolist() == [200]


def test_a_header_of_brackets_takes_no_time():
    began = time.process_time()
    sheet = Sheet.of(CORPUS / "brackets.csv")
    assert [sheet.unit(0), sheet.unit(1)] == [None, "m"]
    assert time.process_time() - began < 1.0


def test_a_file_that_is_there_is_regular(tmp_path):
    (tmp_path / "a").write_text("")
    assert regular(tmp_path / "a") == tmp_path / "a"
