"""Time before all else: split stamps, rows written twice, rounded and backward times; endings of files in any case."""

import json
import shutil

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.draft_pipeline import recording_of, suggestion_of
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import suggest_csv

from tests.records.bags import press, transforms_message, wrench_message, write_bag

RATE, COUNT = 50.0, 400


def table(path, times, repeats=1):
    """A press of 0.3 N under columns of time, by name."""
    down = np.linspace(2.0, -2.0, COUNT)
    force = 0.3 * (np.maximum(-down, 0.0) / 2.0) ** 1.5 + 1e-3 * np.random.default_rng(0).standard_normal(COUNT)
    rows = [[*cells, f"{z:.5f}", f"{f:.5f}"] for *cells, z, f in zip(*times.values(), down, force)]
    lines = [",".join(map(str, row)) + "\n" for row in rows for _ in range(repeats)]
    path.write_text(",".join([*times, "height (mm)", "force (N)"]) + "\n" + "".join(lines))
    return path


def nanoseconds():
    return (np.arange(COUNT) * round(1e9 / RATE)).tolist()


def test_seconds_and_nanoseconds_are_one_time(tmp_path):
    """Nanoseconds alone were the time: a saw of one second, and no contact in the record."""
    stamps = nanoseconds()
    times = {"stamp.sec": [1_700_000_000 + t // 10**9 for t in stamps], "stamp.nanosec": [t % 10**9 for t in stamps]}
    path = table(tmp_path / "stamps.csv", times)
    device = suggest_csv(path, {}).device
    assert device["time"] == {"column": "stamp.sec", "unit": "s", "nanoseconds": "stamp.nanosec"}
    log = CsvReplay.model_validate({key: value for key, value in device.items() if key != "type"})
    with log.connect(0) as link:
        stamp = np.concatenate([batch.time for batch in link.batches()])
    np.testing.assert_allclose(stamp - stamp[0], stamps, atol=500)


def test_nanoseconds_alone_are_no_time(tmp_path):
    path = table(tmp_path / "nano.csv", {"stamp.nanosec": [t % 10**9 for t in nanoseconds()]})
    with pytest.raises(LogError, match=r"restarts every second.*--time"):
        suggest_csv(path, {})


def test_rows_written_twice_are_told(tmp_path):
    path = table(tmp_path / "twice.csv", {"time (s)": [f"{t / RATE:.3f}" for t in range(COUNT)]}, repeats=2)
    with pytest.raises(LogError, match=r"400 of 800 rows have the time of the row before.*written twice"):
        suggest_csv(path, {})


@pytest.mark.parametrize("name", ["time (s)", "Time", "clock"])
def test_rows_that_share_whole_seconds_are_even_within_them(tmp_path, name):
    seconds = [int(t / RATE) for t in range(COUNT)]
    clock = [f"2024-05-01 12:00:{second:02d}" for second in seconds]
    path = table(tmp_path / "whole.csv", {name: clock if name == "clock" else seconds})
    found = suggest_csv(path, {})
    assert found.device["rate"] == "50 Hz"
    assert f"time: column {name} has whole seconds; its 50 rows in a second are taken as even" in found.doubts
    assert suggest_csv(path, {"rate": "51 Hz"}).device["rate"] == "51 Hz"


@pytest.mark.parametrize("loss", [range(120, 128), range(150, 200), range(130, 260)])
def test_whole_seconds_with_rows_missing_need_a_rate(tmp_path, loss):
    """A gap within a second, or of whole ones, would be filled."""
    path = table(tmp_path / "whole.csv", {"time (s)": [int(t / RATE) for t in range(COUNT)]})
    head, *rows = path.read_text().splitlines(keepends=True)
    path.write_text(head + "".join(row for k, row in enumerate(rows) if k not in loss))
    with pytest.raises(LogError, match=r"whole seconds.*--rate"):
        suggest_csv(path, {})
    assert suggest_csv(path, {"rate": "50 Hz"}).device["rate"] == "50 Hz"


def test_a_second_that_two_rows_share_is_no_rate(tmp_path):
    path = table(tmp_path / "two.csv", {"time (s)": [t // 2 for t in range(COUNT)]})
    with pytest.raises(LogError, match=r"whole seconds.*--rate"):
        suggest_csv(path, {})


def test_a_time_that_runs_backwards_is_told(tmp_path):
    path = table(tmp_path / "back.csv", {"time (s)": [f"{(COUNT - t) / RATE:.3f}" for t in range(COUNT)]})
    with pytest.raises(LogError, match=r"runs backwards"):
        suggest_csv(path, {})


@pytest.mark.parametrize(("rate", "gap"), [(10.0, "0.5 s"), (50.0, "0.1 s"), (1000.0, None)])
def test_the_readings_of_a_slow_record_are_no_gaps(tmp_path, rate, gap):
    """At 10 Hz every pause was a gap: no velocity, and values without what Poisson's ratio adds to their ±."""
    path = table(tmp_path / "slow.csv", {"time (s)": [f"{t / rate:.4f}" for t in range(COUNT)]})
    assert suggest_csv(path, {}).alignment.get("gap") == gap


@pytest.mark.slow
def test_a_slow_press_has_a_whole_uncertainty(palpate, tmp_path):
    path = table(tmp_path / "slow.csv", {"time (s)": [f"{t / 10.0:.4f}" for t in range(COUNT)]})
    told = palpate("fit", str(path), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fit"))
    (row,) = json.loads(told.stdout)["files"]
    assert "gaps" not in row["flags"]
    assert "diagnosis-failed" not in row["flags"]
    assert float(row["elasticity_combined"]) > 0.01 * float(row["elasticity"])


@pytest.mark.parametrize("name", ["UPPER.CSV", "Mixed.Csv", "UPPER.TXT"])
def test_endings_are_read_in_any_case(tmp_path, name):
    path = table(tmp_path / "lower.csv", {"time (s)": [f"{t / RATE:.3f}" for t in range(COUNT)]})
    shutil.copy(path, tmp_path / name)
    assert recording_of(tmp_path / name) is CsvReplay
    assert suggestion_of(tmp_path / name, {}).alignment["force"]["sign"] == 1


def log_of_a_press(folder, late=0, frames=("tool0",)):
    """A bag with a wrench, `late` [ns] by its stamps alone, and transforms of frames one after the other."""
    start, wrench, moved = 1_700_000_000 * 10**9, [], []
    for k, (t, z, _, f) in enumerate(zip(*press(), strict=True)):
        stamp = start + round(t * 1e9)
        wrench.append((stamp, wrench_message(stamp + late, "ft", (0, 0, f, 0, 0, 0))))
        for n, name in enumerate(frames):
            place = (0.4, 0.0, z if not n else 0.7 + 0.001 * np.sin(0.01 * k), 0, 0, 0, 1)
            moved.append((stamp + n, transforms_message([(stamp, "base", name, place)])))
    topics = [
        ("/wrench", "geometry_msgs/msg/WrenchStamped", wrench),
        ("/tf", "tf2_msgs/msg/TFMessage", moved),
    ]
    return write_bag(folder / f"press_{late}.db3", topics)


def test_stamps_that_do_not_overlap_are_named_and_the_time_of_the_log_is_taken(tmp_path):
    found = suggestion_of(log_of_a_press(tmp_path, late=3600 * 10**9), {})
    assert found.device["time"] == "log"
    assert any(
        "do not overlap" in text and "3600 s apart" in text and "device.log.time=log" in text for text in found.doubts
    )
    assert "time" not in suggestion_of(log_of_a_press(tmp_path), {}).device


@pytest.mark.parametrize(("late", "behind"), [(2.5, "/tf"), (-1.5, "/wrench")])
def test_stamps_of_clocks_that_are_seconds_apart_are_named(tmp_path, late, behind):
    """They overlap, and the force was paired with heights of seconds before."""
    found = suggestion_of(log_of_a_press(tmp_path, late=round(late * 1e9)), {})
    assert found.device["time"] == "log"
    assert any(f"those of {behind} are {abs(late):g} s behind" in text for text in found.doubts)


def test_a_delay_of_a_network_is_no_other_clock(tmp_path):
    assert "time" not in suggestion_of(log_of_a_press(tmp_path, late=200 * 10**6), {}).device


@pytest.mark.parametrize(
    ("begin", "end", "rows"), [("1 s", None, (50, 400)), (None, "2 s", (0, 101)), ("1 s", "2 s", (50, 101))]
)
@pytest.mark.parametrize("clocked", [True, False])
def test_a_part_of_a_table_is_read_by_its_time(tmp_path, begin, end, rows, clocked):
    """Logs of other formats could be cut, and tables could not."""
    path = table(tmp_path / "press.csv", {"time (s)": [f"{7.0 + t / RATE:.3f}" for t in range(COUNT)]})
    time = {"time": {"column": 0, "unit": "s"}} if clocked else {"rate": f"{RATE} Hz"}
    keys = {key: text for key, text in (("begin", begin), ("end", end)) if text is not None}
    log = CsvReplay.model_validate({"file": path, "columns": {"force": {"column": 2, "unit": "N"}}, **time, **keys})
    with log.connect(0) as link:
        stamps = np.concatenate([batch.time for batch in link.batches()])
    offset = 7.0 if clocked else 0.0
    np.testing.assert_allclose(stamps * 1e-9 - offset, np.arange(*rows) / RATE, atol=1e-9)


def test_several_frames_are_asked_about_and_one_is_read(tmp_path):
    """Both frames were one position."""
    path = log_of_a_press(tmp_path, frames=("tool0", "camera_link"))
    with pytest.raises(LogError, match=r"/tf holds the frames camera_link, tool0.*--position tool0"):
        suggestion_of(path, {})
    signal = suggestion_of(path, {"position": "tool0"}).device["signals"]["position"]
    assert (signal["field"], signal["select"]) == ("transforms.transform.translation.z", "tool0")
