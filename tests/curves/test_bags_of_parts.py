"""A recording in several files is one log for `fit`, as it is for `info`; numbered records are not."""

import json

import numpy as np
import pytest
from palpate import LogError
from palpate_engine import registry
from palpate_kit.curves.alike_logs import logs_among
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_records.bags.bag_folder import Bag

from tests.records.bags import array_message, press, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"


def parts(folder, numbers=(0, 1, 2), pause=0.0, metadata=False, topics=("/data", "/data", "/data")):
    """A press of one topic in several files, with a pause [s] between them; the numbers name those that are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    time, height, velocity, force = press()
    rows = np.array_split(np.column_stack([time, height, velocity, force]), 3)
    for k, (some, topic) in enumerate(zip(rows, topics, strict=True)):
        messages = [(round(1e9 * (row[0] + k * pause)), array_message(row)) for row in some]
        if k in numbers:
            write_bag(folder / f"{folder.name}_{k}.db3", [(topic, ARRAY, messages)])
    if metadata:
        listed = "".join(f"\n    - {folder.name}_{k}.db3" for k in range(3))
        (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:{listed}\n")
    return folder


def names(folder):
    return [str(path.relative_to(folder)) for path in logs_among([folder], registry.load())]


@pytest.mark.parametrize("metadata", [False, True])
def test_parts_of_a_recording_are_one_log(tmp_path, metadata):
    """Each part was a curve of its own."""
    for name in ("one", "two"):
        parts(tmp_path / name, metadata=metadata)
    (tmp_path / "gel.csv").write_text("time (s),height (mm),force (N)\n0,1,0\n")
    assert names(tmp_path) == ["gel.csv", "one", "two"]
    assert names(tmp_path / "one") == ["."]


@pytest.mark.parametrize("kind", [{"pause": 3.0}, {"topics": ("/data", "/other", "/data")}])
def test_records_with_numbers_are_no_parts(tmp_path, kind):
    """Between them is time, or their topics are others; `info` took them for one recording."""
    folder = parts(tmp_path / "press", **kind)
    assert names(folder) == ["press_0.db3", "press_1.db3", "press_2.db3"]
    assert not Rosbag2Replay.recognises(folder)


def test_a_table_beside_parts_is_a_log_of_its_own(tmp_path):
    folder = parts(tmp_path / "press")
    (folder / "gel.csv").write_text("time (s),height (mm),force (N)\n0,1,0\n")
    assert "gel.csv" in names(folder)


def test_lost_parts_are_named(tmp_path):
    with pytest.raises(LogError, match=r"lists one_1\.db3, which is not there; without metadata\.yaml"):
        Bag(parts(tmp_path / "one", (0, 2), metadata=True))
    assert Bag(parts(tmp_path / "two", (0, 2))).trouble == "part 1 of two not there"
    assert Bag(parts(tmp_path / "all")).trouble is None
    far = parts(tmp_path / "far", (0,))
    write_bag(far / "far_99999999999999999.db3", [("/data", ARRAY, [])])
    assert Bag(far).trouble == "parts 1, 2, 3, 4, 5, ... of far not there"


@pytest.mark.slow
def test_a_recording_in_parts_is_fitted_as_a_whole(palpate, tmp_path, monkeypatch):
    """49.5, 50.0 and invalid were found of the three parts of a press of 50."""
    monkeypatch.chdir(tmp_path)
    parts(tmp_path / "in" / "press", metadata=True)
    keys = ["--set", "device.log.signals.force.unit=N"] * 0
    told = palpate("fit", "in", "--tip", "paraboloid 5 mm", "--json", "-o", "fits", *keys)
    (row,) = json.loads(told.stdout)["files"]
    assert row["curve"] == "in/press"
    assert row["verdict"] in ("good", "doubtful"), told.stderr
    assert palpate("fit", "fits", "--thickness", "30 mm").returncode == 0
