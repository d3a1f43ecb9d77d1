"""`palpate log recover`, `export` and `compare`."""

import csv
import sqlite3
import sys
from contextlib import closing

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_devices.mcap_replay import McapReplay
from palpate_logs.commands.export import export
from palpate_logs.rosbag2_replay import Rosbag2Replay

from tests.records.bags import array_message, write_bag


@pytest.fixture
def recording(run_point):
    """The log of a short run."""
    short = ("trajectory.press.duration=1 s", "trajectory.press.speed=20 mm/s")
    return run_point(*short, name="recording").folder / "log.mcap"


def numbers(path, **keys):
    with McapReplay(file=path, **keys).connect(0) as link:
        batches = list(link.batches())
    names = {batch.stream for batch in batches}
    return {name: np.concatenate([b.values for b in batches if b.stream == name]) for name in names}


def test_what_is_recovered_is_whole_and_the_same(palpate, recording, tmp_path):
    raw = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw[: len(raw) * 3 // 4])
    done = palpate("log", "recover", cut, "-o", "good.mcap")
    assert done.returncode == 0, done.stderr
    assert "messages over" in done.stdout
    assert "everything after that is lost" in done.stdout
    found, true = numbers(tmp_path / "good.mcap"), numbers(recording)
    for name, values in found.items():
        np.testing.assert_array_equal(values, true[name][: len(values)])
    assert len(found["wrench"]) > 500
    from mcap.reader import make_reader

    with (tmp_path / "good.mcap").open("rb") as file:
        reader = make_reader(file)
        assert {a.name for a in reader.iter_attachments()} >= {"pipeline.toml", "given.toml"}
        assert "seed" in next(m for m in reader.iter_metadata() if m.name == "palpate").metadata


@pytest.mark.slow
def test_recovery_of_a_whole_log_of_nothing_and_onto_something(palpate, recording, tmp_path):
    done = palpate("log", "recover", recording, "-o", "again.mcap")
    assert done.stdout.startswith("the log was whole: ")
    assert numbers(tmp_path / "again.mcap").keys() == numbers(recording).keys()
    for source, out, words in (
        (recording, "again.mcap", "exists already"),
        ("none.mcap", "x.mcap", "no such file"),
        ("head.mcap", "x.mcap", "nothing in it is undamaged"),
    ):
        (tmp_path / "head.mcap").write_bytes(recording.read_bytes()[:60])
        refused = palpate("log", "recover", source, "-o", out)
        assert refused.returncode == 2
        assert words in refused.stderr
        assert not (tmp_path / "x.mcap").exists()


@pytest.mark.parametrize("whole", [0.3, 0.9, 1.0])
def test_a_bag_that_is_cut_gives_what_is_whole(palpate, tmp_path, whole):
    messages = [(i * 10**6, array_message([0.0, i / 8])) for i in range(5000)]
    raw = write_bag(tmp_path / "bag.db3", [("/data", "std_msgs/msg/Float64MultiArray", messages)]).read_bytes()
    (tmp_path / "bag.db3").write_bytes(raw[: int(whole * len(raw))])
    if whole < 1.0:
        refused = palpate("log", "export", "bag.db3", "-o", "x.csv")
        assert (refused.returncode, "damaged" in refused.stderr) == (2, True)
    done = palpate("log", "recover", "bag.db3", "-o", "good.db3")
    assert done.returncode == 0, done.stderr
    assert ("are lost" in done.stdout) == (whole < 1.0)
    signals = {"z": {"topic": "/data", "field": "data", "index": 1, "unit": "m"}}
    with Rosbag2Replay.model_validate({"file": tmp_path / "good.db3", "signals": signals}).connect(0) as link:
        batches = list(link.batches())
    time = np.concatenate([batch.time for batch in batches])
    np.testing.assert_array_equal(np.concatenate([b.values[:, 0] for b in batches]), time // 10**6 / 8)
    assert len(time) > 0.8 * whole * len(messages)
    assert f"{len(time)} messages over" in done.stdout
    assert "exists already" in palpate("log", "recover", "bag.db3", "-o", "good.db3").stderr


@pytest.mark.slow
def test_messages_of_many_pages_are_whole_or_not_there(tmp_path):
    messages = [(i, array_message(np.full(3000, i + 0.1))) for i in range(40)]
    raw = write_bag(tmp_path / "bag.db3", [("/data", "std_msgs/msg/Float64MultiArray", messages)]).read_bytes()
    for cut in np.linspace(0.2, 0.999, 12):
        (tmp_path / "cut.db3").write_bytes(raw[: int(cut * len(raw))])
        out = tmp_path / f"{cut}.db3"
        Rosbag2Replay.recover(tmp_path / "cut.db3", out)
        with closing(sqlite3.connect(out)) as database:
            found = database.execute("SELECT timestamp, data FROM messages").fetchall()
        assert len(found) > 0.5 * cut * len(messages)
        assert all(data == messages[stamp][1] for stamp, data in found)


@pytest.mark.parametrize("content", [b"", b"no database", b"SQLite format 3\0" + b"\xff" * 200])
def test_what_is_no_bag_cannot_be_recovered(palpate, tmp_path, content):
    (tmp_path / "bag.db3").write_bytes(content)
    refused = palpate("log", "recover", "bag.db3", "-o", "x.db3")
    assert refused.returncode == 2
    assert "bag.db3: " in refused.stderr
    assert not (tmp_path / "x.db3").exists()


@pytest.fixture
def bag(tmp_path):
    """Two topics, one of them at half the rate; two messages of one instant."""
    kind = "std_msgs/msg/Float64MultiArray"
    fast = [(10 * i, array_message([i, i * i])) for i in range(6)]
    slow = [(0, array_message([-1.0])), (20, array_message([-2.0])), (20, array_message([-3.0]))]
    return write_bag(tmp_path / "bag.db3", [("/fast", kind, fast), ("/slow", kind, slow)])


def test_export_to_a_table(palpate, bag, tmp_path):
    done = palpate("log", "export", bag.name, "-o", "x.csv")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["stamp_ns"] for row in rows] == ["0", "10", "20", "20", "30", "40", "50"]
    assert [row["/fast:data[1]"] for row in rows] == ["0.0", "1.0", "4.0", "", "9.0", "16.0", "25.0"]
    assert [row["/slow:data[0]"] for row in rows] == ["-1.0", "", "-2.0", "-3.0", "", "", ""]


def test_export_to_arrays(palpate, bag, tmp_path):
    from scipy.io import loadmat

    assert palpate("log", "export", bag.name, "-o", "x.npz", "--topic", "/fast").returncode == 0
    with np.load(tmp_path / "x.npz") as arrays:
        assert arrays["fast:data[1]"].tolist() == [0, 1, 4, 9, 16, 25]
        assert arrays["fast:stamp_ns"].tolist() == [0, 10, 20, 30, 40, 50]
        assert not [name for name in arrays if name.startswith("slow")]
    assert palpate("log", "export", bag.name, "-o", "x.mat").returncode == 0
    assert loadmat(tmp_path / "x.mat")["slow"]["data_0"][0, 0].ravel().tolist() == [-1, -2, -3]


def test_texts_are_exported_beside_the_numbers(palpate, tmp_path):
    """A topic of texts alone, and one of JSON that holds both."""
    from mcap.writer import Writer

    from tests.records.bags import Cdr

    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        kind = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        notes, state = writer.register_channel("/notes", "cdr", kind), writer.register_channel("/state", "json", 0)
        for i, words in enumerate(("soft, then hard", 'a "lump"', "soft, then hard")):
            writer.add_message(notes, 10 * i, bytes(Cdr().text(words)), 10 * i)
            writer.add_message(state, 10 * i, f'{{"mode": "m{i % 2}", "level": {i}}}'.encode(), 10 * i)
        writer.finish()
    done = palpate("log", "export", "log.mcap", "-o", "x.csv")
    assert done.stdout == "6 messages of 2 topics are in x.csv\n"
    with (tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["/notes:data"] for row in rows] == ["soft, then hard", 'a "lump"', "soft, then hard"]
    assert [(row["/state:mode"], row["/state:level"]) for row in rows] == [("m0", "0.0"), ("m1", "1.0"), ("m0", "2.0")]
    assert palpate("log", "export", "log.mcap", "-o", "x.npz", "--topic", "/notes").returncode == 0
    with np.load(tmp_path / "x.npz") as arrays:
        assert arrays["notes:data"].tolist() == ["soft, then hard", 'a "lump"', "soft, then hard"]
    assert palpate("log", "export", "log.mcap", "-o", "x.mat").returncode == 0


def test_export_to_parquet(palpate, bag, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="parquet needs pyarrow")
    done = palpate("log", "export", bag.name, "-o", "x.parquet")
    assert done.returncode == 0, done.stderr
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table["stamp_ns"].to_pylist() == [0, 10, 20, 20, 30, 40, 50]
    found = table["/fast:data[1]"].to_pylist()
    np.testing.assert_array_equal(found, [0.0, 1.0, 4.0, np.nan, 9.0, 16.0, 25.0])


def test_export_to_parquet_without_its_library_says_what_to_install(bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigurationError, match="pip install pyarrow"):
        export(bag, tmp_path / "x.parquet", None)
    assert not (tmp_path / "x.parquet").exists()


@pytest.mark.parametrize("window", [1, 2, 3, 7, 50_000])
def test_a_table_is_the_same_however_it_is_cut(tmp_path, monkeypatch, window):
    """Messages of one instant, more of them than a window holds, and time-stamps out of order."""
    stamps = {"/a": [5, 1, 1, 1, 1, 3, 9, 9, 2, 30], "/b": [0, 1, 1, 4, 9, 9, 9, 9, 40, 41, 42], "/c": [100]}
    kind = "std_msgs/msg/Float64MultiArray"
    topics = [(t, kind, [(s, array_message([float(i)])) for i, s in enumerate(found)]) for t, found in stamps.items()]
    bag = write_bag(tmp_path / "bag.db3", topics)
    monkeypatch.setattr("palpate_logs.topic_arrays._SORTED_ROWS", window)
    monkeypatch.setattr("palpate_logs.table_windows._MAX_WINDOW_ROWS", window)
    export(bag, tmp_path / "x.csv", None)
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    seen = [int(row["stamp_ns"]) for row in rows]
    most = {s: max(found.count(s) for found in stamps.values()) for found in stamps.values() for s in found}
    assert seen == sorted(s for s, count in most.items() for _ in range(count))
    for topic, found in stamps.items():
        cells = [(int(r["stamp_ns"]), float(c)) for r in rows if (c := r[f"{topic}:data[0]"])]
        assert cells == sorted(zip(found, map(float, range(len(found))), strict=True))
    assert not list(tmp_path.glob(".palpate-*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "x.doc"), "the name must end in one of .csv, .npz, .mat, .parquet"),
        (("-o", "bag.csv"), "exists already"),
        (
            ("-o", "x.csv", "--topic", "/none"),
            "--topic /none: contains no numbers and no texts (there are: /fast, /slow)",
        ),
        (("-o", "no/where.csv"), "cannot write"),
    ],
)
def test_exports_that_cannot_be(palpate, bag, tmp_path, arguments, words):
    (tmp_path / "bag.csv").write_text("")
    refused = palpate("log", "export", bag.name, *arguments)
    assert refused.returncode == 2
    assert words in refused.stderr


@pytest.mark.gate
@pytest.mark.slow
def test_an_exported_recording_replays_from_csv(palpate, recording, tmp_path):
    assert palpate("log", "export", recording, "-o", "x.csv", "--topic", "/rig/wrench").returncode == 0
    with (tmp_path / "x.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = [float(row["/rig/wrench:wrench.force.z"]) for row in rows]
    np.testing.assert_array_equal(found, numbers(recording)["wrench"][:, 2])


@pytest.mark.slow
def test_a_choice_on_a_log_of_others_by_the_names_of_models(palpate, shared):
    log = shared / "rosbag2" / "ur3e_load_unload_soft_1.db3.gz"
    done = palpate("fit", "choose", log, "--models", "dr,kelvin-voigt", "--set", "indenter.tip.radius=3 mm")
    assert done.returncode == 0, done.stderr
    assert "kelvin-voigt" in done.stdout
    assert "check: " in done.stderr  # what is a guess
    refused = palpate("fit", "choose", log, "--models", "dr,kelvin-voight")
    assert refused.returncode == 2
    assert "did you mean 'kelvin-voigt'?" in refused.stderr


def flip_in(path, text):
    """One bit, at a text that the file has."""
    raw = bytearray(path.read_bytes())
    raw[raw.index(text) + len(text) // 2] ^= 1
    path.write_bytes(raw)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["none", "pipeline", "pipeline, and none beside"])
def test_a_recovered_log_is_replayed(palpate, recording, tmp_path, damage):
    """Of a run that was killed: its log ends early, and its folder has no result."""
    folder = tmp_path / "killed"
    folder.mkdir()
    raw = recording.read_bytes()
    (folder / "log.mcap").write_bytes(raw[: len(raw) * 3 // 4])
    if damage != "pipeline, and none beside":
        for name in ("pipeline.toml", "given.toml"):
            (folder / name).write_bytes((recording.parent / name).read_bytes())
    if damage != "none":
        flip_in(folder / "log.mcap", b"dimensionality-reduction")
    done = palpate("log", "recover", folder / "log.mcap", "-o", tmp_path / "good.mcap")
    assert done.returncode == 0, done.stderr
    assert ("with pipeline.toml from next to" in done.stdout) == (damage == "pipeline")
    attached = McapReplay.attached(tmp_path / "good.mcap")
    done = palpate("replay", tmp_path / "good.mcap", "--out", tmp_path / "again")
    if damage == "pipeline, and none beside":
        assert done.returncode == 2
        assert "carries no pipeline" in done.stderr
        return
    assert done.returncode == 0, done.stderr
    assert attached.documents["pipeline.toml"] == (recording.parent / "pipeline.toml").read_text()
    assert attached.facts["seed"] == McapReplay.attached(recording).facts["seed"]
    again, before = (
        (path / "estimates.csv").read_text().splitlines() for path in (tmp_path / "again", recording.parent)
    )
    assert len(again) > len(before) // 2
    assert again[:-1] == before[: len(again) - 1]
