"""rosbag2 bags: databases, folders, split and compressed files, and what is read of their messages."""

import gzip
import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from palpate import LogError, OutputError
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_testing import check_device

from tests.records.bags import array_message, joints_message, press, transforms_message, wrench_message, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"
SIGNALS = {"z": {"topic": "/data", "field": "data", "index": 1, "unit": "mm"}}


def bag_of(path, rows, first=1000, big=False):
    messages = [(first + 2_000_000 * i, array_message(row, big)) for i, row in enumerate(rows)]
    return write_bag(path, [("/data", ARRAY, messages)])


def read(device):
    with device.connect(0) as link:
        batches = list(link.batches())
    return np.concatenate([b.time for b in batches]), np.concatenate([b.values for b in batches])


def rows_of(path):
    with closing(sqlite3.connect(path)) as database:
        return set(database.execute("SELECT id, topic_id, timestamp, data FROM messages").fetchall())


def device_on(path, signals=SIGNALS, **keys):
    return Rosbag2Replay.model_validate({"file": path, "signals": signals, **keys})


@pytest.mark.parametrize("big", [False, True])
def test_an_element_of_an_array_in_its_unit(tmp_path, big):
    device = device_on(bag_of(tmp_path / "bag.db3", [[0.0, 1.5, 9.0], [0.002, -2.5, 9.0]], big=big))
    time, values = read(device)
    assert time.tolist() == [1000, 2_001_000]
    np.testing.assert_array_equal(values[:, 0], [0.0015, -0.0025])
    check_device(device)


def test_the_time_can_be_a_number_in_the_messages(tmp_path):
    device = device_on(
        bag_of(tmp_path / "bag.db3", [[1.7e9 + 0.25, 1.0], [1.7e9 + 0.75, 2.0], [np.nan, 3.0]]),
        time={"field": "data", "index": 0},
    )
    time, values = read(device)
    assert time.tolist() == [1_700_000_000_250_000_000, 1_700_000_000_750_000_000]
    assert len(values) == 2


def test_messages_of_different_lengths_in_one_topic(tmp_path):
    rows = [[0.0, 1.0], [0.0, 2.0, 3.0], [0.0], [0.0, 4.0], []]
    _, values = read(device_on(bag_of(tmp_path / "bag.db3", rows)))
    np.testing.assert_array_equal(values[:, 0], np.array([1.0, 2.0, np.nan, 4.0, np.nan]) / 1000)


@pytest.mark.parametrize("suffix", [".gz", ".zstd"])
def test_compressed_files(tmp_path, suffix):
    import zstandard

    plain = bag_of(tmp_path / "bag.db3", [[0.0, 1.0], [0.0, 2.0]])
    pack = gzip.compress if suffix == ".gz" else zstandard.ZstdCompressor().compress
    packed = tmp_path / f"bag.db3{suffix}"
    packed.write_bytes(pack(plain.read_bytes()))
    assert read(device_on(packed))[1][:, 0].tolist() == [0.001, 0.002]
    packed.write_bytes(packed.read_bytes()[:-30])
    with pytest.raises(LogError, match=r"bag\.db3\..*(cannot be read|damaged)"):
        _ = device_on(packed).streams


@pytest.mark.parametrize("metadata", ["block", "inline", "none"])
def test_a_folder_of_split_files_in_their_order(tmp_path, metadata):
    numbers = (0, 1, 2, 10)
    for i in numbers:
        bag_of(tmp_path / f"bag_{i}.db3", [[0.0, float(i)]], first=i * 10**9)
    names = [f"bag_{i}.db3" for i in numbers]
    listed = {
        "block": "".join(f"\n    - {name}" for name in names),
        "inline": f" [{', '.join(names)}]",
    }
    if metadata != "none":
        text = f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:{listed[metadata]}\n  duration: 1\n"
        (tmp_path / "metadata.yaml").write_text(text)
    assert (read(device_on(tmp_path))[1][:, 0] * 1000).tolist() == [0, 1, 2, 10]
    if metadata != "none":
        (tmp_path / "bag_2.db3").unlink()
        with pytest.raises(LogError, match=r"metadata\.yaml lists bag_2\.db3"):
            _ = device_on(tmp_path).streams


def test_messages_compressed_one_by_one(tmp_path):
    import zstandard

    packed = [(i, zstandard.ZstdCompressor().compress(array_message([0.0, float(i)]))) for i in range(3)]
    write_bag(tmp_path / "bag_0.db3", [("/data", ARRAY, packed)])
    (tmp_path / "metadata.yaml").write_text(
        "info:\n  relative_file_paths:\n    - bag_0.db3\n  compression_format: zstd\n  compression_mode: MESSAGE\n"
    )
    assert (read(device_on(tmp_path))[1][:, 0] * 1000).tolist() == [0, 1, 2]


def test_what_a_killed_recorder_left_in_its_journal_is_read(tmp_path):
    """A database in WAL mode: the messages are beside it, until somebody closes it."""
    live = bag_of(tmp_path / "live.db3", [[0.0, 1.0]])
    with closing(sqlite3.connect(live)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        for i in range(2, 50):
            row = (1, 1000 * i, array_message([0.0, float(i)]))
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
        database.commit()
        for name in ("", "-wal"):
            shutil.copyfile(f"{live}{name}", tmp_path / f"bag.db3{name}")
    before = {path.name: path.read_bytes() for path in tmp_path.glob("bag.db3*")}
    assert (read(device_on(tmp_path / "bag.db3"))[1][:, 0] * 1000).round(9).tolist() == list(range(1, 50))
    assert "49 messages" in Rosbag2Replay.recover(tmp_path / "bag.db3", tmp_path / "good.db3")
    assert {path.name: path.read_bytes() for path in tmp_path.glob("bag.db3*")} == before


@pytest.mark.parametrize("number", [2**40, 2**60, 2**63 - 1, -5], ids=str)
def test_a_message_may_have_any_number(tmp_path, number):
    """As where a bit of it has changed: none is lost, and nobody looks through all numbers between."""
    bag = bag_of(tmp_path / "bag.db3", [[0.0, float(i)] for i in range(100)])
    with closing(sqlite3.connect(bag)) as database:
        database.execute("UPDATE messages SET id = ? WHERE id = (SELECT MAX(id) FROM messages)", (number,))
        database.commit()
    said = Rosbag2Replay.recover(bag, tmp_path / "good.db3")
    assert said.startswith("the bag was whole: 100 messages")
    assert rows_of(tmp_path / "good.db3") == rows_of(bag)


@pytest.mark.slow
@pytest.mark.parametrize("far", [1, 2**30], ids=["in a row", "far apart"])
def test_a_page_that_cannot_be_read_costs_what_stands_in_it(tmp_path, far):
    """A page in the middle, also where the numbers of its messages are so far apart that none is found by counting."""
    bag = bag_of(tmp_path / "bag.db3", [[float(i)] * 20 for i in range(3000)])
    with closing(sqlite3.connect(bag)) as database:
        database.execute("UPDATE messages SET id = id * ?", (far,))
        database.commit()
        database.execute("VACUUM")
        (size,) = database.execute("PRAGMA page_size").fetchone()
    raw, before = bytearray(bag.read_bytes()), rows_of(bag)
    leaves = [at for at in range(size, len(raw), size) if raw[at] == 13]
    leaf = leaves[len(leaves) // 2]
    raw[leaf : leaf + size] = b"\xaa" * size
    bag.write_bytes(raw)
    said = Rosbag2Replay.recover(bag, tmp_path / "good.db3")
    after = rows_of(tmp_path / "good.db3")
    assert after < before
    assert max(before) == max(after)
    assert len(before) - len(after) <= size // 160
    assert said.startswith(f"{len(after)} messages")


@pytest.mark.slow
def test_a_message_between_pages_that_cannot_be_read_is_kept(tmp_path):
    """Each page has one message, and of a thousand pages in a row one can be read."""
    bag = bag_of(tmp_path / "bag.db3", [[float(i)] * 400 for i in range(1500)])
    with closing(sqlite3.connect(bag)) as database:
        (size,) = database.execute("PRAGMA page_size").fetchone()
    raw, before = bytearray(bag.read_bytes()), rows_of(bag)
    leaves = [at for at in range(size, len(raw), size) if raw[at] == 13]
    kept_row = 900
    for leaf in (*leaves[100:kept_row], *leaves[kept_row + 1 : 1100]):
        raw[leaf : leaf + size] = b"\xaa" * size
    bag.write_bytes(raw)
    Rosbag2Replay.recover(bag, tmp_path / "good.db3")
    after = rows_of(tmp_path / "good.db3")
    assert len(before) - len(after) == 999
    assert after < before


@pytest.mark.parametrize("missing", [1, 1000, 3000])
def test_a_database_without_its_last_bytes_is_refused(tmp_path, missing):
    """SQLite reads the rest of a page that is cut as zeros, and its messages as if they had never been."""
    bag = bag_of(tmp_path / "bag.db3", [[0.0, float(i)] for i in range(2000)])
    bag.write_bytes(bag.read_bytes()[:-missing])
    with pytest.raises(LogError, match=rf"bag\.db3: the database is damaged: its last {missing} bytes are missing"):
        read(device_on(bag))
    assert "; unreadable messages are lost" in Rosbag2Replay.recover(bag, tmp_path / "good.db3")


def test_a_recovery_overwrites_nothing(tmp_path):
    bag = bag_of(tmp_path / "bag.db3", [[0.0, 1.0]])
    (tmp_path / "good.db3").write_text("mine")
    with pytest.raises(OutputError, match=r"good\.db3: exists already, and nothing is ever overwritten"):
        Rosbag2Replay.recover(bag, tmp_path / "good.db3")
    assert (tmp_path / "good.db3").read_text() == "mine"


def test_a_time_stamp_that_is_no_number_is_refused(tmp_path):
    bag = bag_of(tmp_path / "bag.db3", [[0.0, float(i)] for i in range(10)])
    with closing(sqlite3.connect(bag)) as database:
        database.execute("UPDATE messages SET timestamp = x'00ff' WHERE id = 5")
        database.commit()
    with pytest.raises(LogError, match=r"bag\.db3: .* a message has no time-stamp"):
        _ = device_on(bag).duration


def test_only_a_window_of_time(tmp_path):
    path = bag_of(tmp_path / "bag.db3", [[0.0, float(i)] for i in range(100)])
    time, _ = read(device_on(path, begin="20 ms", end="40 ms"))
    assert time.tolist() == [1000 + 2_000_000 * i for i in range(10, 20)]


def test_a_joint_is_found_by_its_name_wherever_it_stands(tmp_path):
    first = joints_message(10**9, ["hip", "toe"], [1.0, 2.0])
    swapped = joints_message(2 * 10**9, ["toe", "hip"], [3.0, 4.0])
    other = joints_message(3 * 10**9, ["arm", "leg"], [5.0, 6.0])
    messages = [(i, m) for i, m in enumerate((first, swapped, other, first, other))]
    path = write_bag(tmp_path / "bag.db3", [("/joints", "sensor_msgs/msg/JointState", messages)])
    signals = {"toe": {"topic": "/joints", "field": "position", "select": "toe", "unit": "rad"}}
    time, values = read(device_on(path, signals))
    assert values[:, 0].tolist() == [2.0, 3.0, 2.0]
    assert time.tolist() == [10**9, 2 * 10**9, 10**9]


def test_a_transform_is_found_by_its_child_frame(tmp_path):
    def row(z):
        return [0, 0, z, 0, 0, 0, 1]

    messages = [
        (1, transforms_message([(5, "base", "tool0", row(1.0))])),
        (2, transforms_message([(6, "base", "other", row(2.0))])),
        (3, transforms_message([(7, "world", "base", row(3.0)), (8, "base", "tool0", row(4.0))])),
    ]
    path = write_bag(tmp_path / "bag.db3", [("/tf", "tf2_msgs/msg/TFMessage", messages)])
    field = "transforms.transform.translation.z"
    time, values = read(device_on(path, {"z": {"topic": "/tf", "field": field, "select": "tool0", "unit": "m"}}))
    assert values[:, 0].tolist() == [1.0, 4.0]
    assert time.tolist() == [5, 8]


def test_topics_that_end_alike_get_their_whole_name(tmp_path):
    wrench = "geometry_msgs/msg/WrenchStamped"
    rows = [(i, wrench_message(i, "f", range(6))) for i in range(3)]
    path = write_bag(tmp_path / "bag.db3", [("/bus0/wrench", wrench, rows), ("/ur/wrench", wrench, rows)])
    signals = {
        name: {"topic": topic, "field": "wrench.force.z", "unit": "N"}
        for name, topic in (("a", "/bus0/wrench"), ("b", "/ur/wrench"))
    }
    assert [stream.name for stream in device_on(path, signals).streams] == ["bus0_wrench", "ur_wrench"]


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        (
            {"topic": "/none", "field": "data", "index": 0},
            r"topic '/none' of 'z' is not in the log \(there are: /data\)",
        ),
        ({"topic": "/data", "field": "wrong"}, "have no number 'wrong' .*data"),
        ({"topic": "/data", "field": "data"}, "is an array of 2: give index, 0 to 1"),
        ({"topic": "/data", "field": "data", "index": 2}, "has 2 elements: index 2 is beyond them"),
        ({"topic": "/data", "field": "layout.data_offset", "index": 0}, "is one number: leave out index"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused_with_what_there_is(tmp_path, signal, words):
    path = bag_of(tmp_path / "bag.db3", [[0.0, 1.0]])
    with pytest.raises(LogError, match=words):
        _ = device_on(path, {"z": signal}).streams


@pytest.mark.parametrize("content", [b"", b"no database at all", b"SQLite format 3\0" + b"\xff" * 200])
def test_what_is_no_bag_is_refused(tmp_path, content):
    path = tmp_path / "bag.db3"
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"bag\.db3: (is not a rosbag2 database|the database is damaged)"):
        _ = device_on(path).streams


def test_a_type_nobody_defines_is_refused_when_it_is_mapped_only(tmp_path):
    rows = [(i, array_message([0.0, 1.0])) for i in range(3)]
    path = write_bag(tmp_path / "bag.db3", [("/data", ARRAY, rows), ("/odd", "lab_msgs/msg/Odd", rows)])
    assert len(read(device_on(path))[1]) == 3
    with pytest.raises(LogError, match=r"topic /odd: the log does not define lab_msgs/msg/Odd"):
        _ = device_on(path, {"z": {"topic": "/odd", "field": "data"}}).streams


@pytest.mark.parametrize("sign", [1, -1])
def test_roles_are_found_in_numbers_without_names(tmp_path, sign):
    time, height, speed, force = press()
    desired = height.round(5)
    rows = np.column_stack([time + 1.7e9, np.full(len(time), 7.0), sign * height, speed * sign, -force * sign])
    suggestion = Rosbag2Replay.suggest(bag_of(tmp_path / "bag.db3", rows, first=17 * 10**17), {})
    found = {name: signal["index"] for name, signal in suggestion.device["signals"].items()}
    assert found == {"position": 2, "velocity": 3, "force": 4}
    assert suggestion.device["time"] == {"field": "data", "index": 0, "unit": "s"}
    signs = {role: suggestion.alignment[role]["sign"] for role in found}
    assert signs == {"force": -sign, "position": sign, "velocity": sign}
    assert len(desired) == len(time)


@pytest.mark.slow
def test_two_wrenches_are_never_picked_by_accident(tmp_path):
    wrench = "geometry_msgs/msg/WrenchStamped"
    _, height, _, force = press()
    rows = [(i * 2_000_000, wrench_message(i * 2_000_000, "f", [0, 0, f, 0, 0, 0])) for i, f in enumerate(force)]
    poses = [(i * 2_000_000, wrench_message(i * 2_000_000, "b", [0, 0, z, 0, 0, 0, 1])) for i, z in enumerate(height)]
    path = write_bag(
        tmp_path / "bag.db3",
        [
            ("/bota/wrench", wrench, rows),
            ("/ur/wrench", wrench, rows),
            ("/pose", "geometry_msgs/msg/PoseStamped", poses),
        ],
    )
    (doubt,) = [text for text in Rosbag2Replay.suggest(path, {}).doubts if text.startswith("force:")]
    assert "is a guess" in doubt
    assert "it could be --force /" in doubt
    assert "/bota/wrench:wrench.force.z" in doubt
    assert "/ur/wrench:wrench.force.z" in doubt
    chosen = Rosbag2Replay.suggest(path, {"force": "/bota/wrench"})
    assert chosen.device["signals"]["force"]["topic"] == "/bota/wrench"
    assert not [text for text in chosen.doubts if text.startswith("force:")]
    assert chosen.alignment["position"] == {"channel": "log.pose.position", "sign": 1}
    with pytest.raises(LogError, match="topic '/none' holds no numbers"):
        Rosbag2Replay.suggest(path, {"force": "/none"})


@pytest.mark.slow
def test_the_authors_bags_hold_what_their_notes_say(shared):
    counts = {"ur3e_load_unload_soft_1": (9744, 3, 5), "foam_white_1_p": (4800, 2, 5)}
    for name, (count, position, force) in counts.items():
        path = shared / "rosbag2" / f"{name}.db3.gz"
        (topic,) = Rosbag2Replay.survey(path).topics
        assert (topic.messages, topic.gaps) == (count, 0)
        signals = Rosbag2Replay.suggest(path, {}).device["signals"]
        assert (signals["position"]["index"], signals["force"]["index"]) == (position, force)
