"""`[estimates] format = "parquet"`: the same table in columns, and nothing lost of a run that is killed."""

import importlib.util
import shutil

import numpy as np
import pytest
from palpate import Estimates, OutputError, Parameter, Samples
from palpate.errors import LogError
from palpate_kit.runs import estimates_parquet
from palpate_kit.runs.replay_source import log_in
from palpate_kit.runs.run_folder import RunFolder
from palpate_maps.path_reader import tracks_of

pytest.importorskip("pyarrow")
PARAMETER = Parameter("elasticity", "", "Pa", "")


def block(begin, count):
    """Samples every millisecond, and estimates that tell which they are."""
    time = 1e-3 * np.arange(begin, begin + count)
    column, none = time.copy(), np.zeros(count, bool)
    samples = Samples((1e9 * time).astype(np.int64), time, time, column, column, column, none, none)
    values = np.column_stack([1e5 + time])
    found = Estimates(time, values, 0.1 * values, time, time, time, time, np.full(count, 5, np.uint32))
    return samples, {"dr/ekf": found}


@pytest.fixture
def growing(tmp_path, monkeypatch):
    """A table that gets a batch with every block, and is closed at the end of the test."""
    monkeypatch.setattr(estimates_parquet, "_WAIT", -1.0)
    with estimates_parquet.estimates_parquet(tmp_path / "estimates", {"dr/ekf": (PARAMETER,)}, 0.0) as table:
        yield table


@pytest.mark.slow
def test_a_run_in_parquet_reads_back_as_one_in_text(run_point):
    short = "trajectory.press.duration=2 s"
    text, columns = run_point(short, name="text"), run_point(short, "estimates.format=parquet", name="columns")
    assert {path.name for path in columns.folder.glob("estimates*")} == {"estimates.parquet"}
    (one,), (other,) = RunFolder(text.folder).tables, RunFolder(columns.folder).tables
    assert one.names == other.names
    np.testing.assert_allclose(other.numbers, one.numbers, rtol=1e-9)
    assert (other.track("dr/ekf").status == one.track("dr/ekf").status).all()
    assert tracks_of(columns.folder) == tracks_of(text.folder) == ["dr/ekf"]


def test_a_table_of_estimates_is_no_log_of_the_run(tmp_path):
    """A table of any other name is read as a log."""
    import pyarrow
    from pyarrow import feather, parquet

    table = pyarrow.table({name: np.arange(60.0) for name in ("time_s", "force_N", "height_mm")})
    (tmp_path / "pipeline.toml").write_text("")
    parquet.write_table(table, tmp_path / "estimates.parquet")
    with pytest.raises(LogError, match=r"expected one log in a run folder \(none\)"):
        log_in(tmp_path)
    feather.write_feather(table, tmp_path / "log.feather")
    assert log_in(tmp_path) == tmp_path / "log.feather"


def test_what_is_killed_keeps_its_rows(growing, tmp_path):
    for begin in (0, 100, 200):
        growing.write(*block(begin, 100))
        found = RunFolder(tmp_path).tracks["dr/ekf"]  # by another process, as after a kill: nothing was closed
        assert found.time[-1] == pytest.approx(1e-3 * (begin + 99))
        np.testing.assert_array_equal(found.values["elasticity"], 1e5 + found.time)
        assert (found.status == 5).all()


def test_a_stream_that_is_torn_anywhere_gives_what_is_whole(growing, tmp_path):
    growing.write(*block(0, 50))
    head = (tmp_path / "estimates.arrows").stat().st_size
    growing.write(*block(50, 50))
    whole = (tmp_path / "estimates.arrows").read_bytes()
    torn = tmp_path / "torn"
    torn.mkdir()
    for size in (head, head + 1, (head + len(whole)) // 2, len(whole) - 1, len(whole)):
        (torn / "estimates.arrows").write_bytes(whole[:size])
        assert len(RunFolder(torn).places[0]) == (100 if size == len(whole) else 50)
    (torn / "estimates.arrows").write_bytes(b"")
    assert RunFolder(torn).tracks == {}
    (torn / "estimates.arrows").write_bytes(b"time_s,x_m\n" * 9)
    with pytest.raises(LogError, match=r"estimates\.arrows: is not a table of numbers"):
        _ = RunFolder(torn).tables


def test_many_groups_of_rows_are_one_table(tmp_path, monkeypatch):
    monkeypatch.setattr(estimates_parquet, "_GROUP", 64)
    monkeypatch.setattr(estimates_parquet, "_TOGETHER", 32)
    with estimates_parquet.estimates_parquet(tmp_path / "estimates", {"dr/ekf": (PARAMETER,)}, 2e-3) as table:
        for begin in range(0, 1000, 20):
            table.write(*block(begin, 20))
    np.testing.assert_allclose(RunFolder(tmp_path).places[0], 2e-3 * np.arange(500), atol=1e-12)


def test_a_run_that_is_stopped_has_its_table(tmp_path):
    context = estimates_parquet.estimates_parquet(tmp_path / "estimates", {"dr/ekf": (PARAMETER,)}, 0.0)
    table = context.__enter__()
    table.write(*block(0, 10))
    assert not context.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert [path.name for path in tmp_path.iterdir()] == ["estimates.parquet"]
    assert len(RunFolder(tmp_path).places[0]) == 10


def test_a_disk_that_is_full_at_the_end_leaves_the_stream(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(estimates_parquet, "_to_parquet", full)
    context = estimates_parquet.estimates_parquet(tmp_path / "estimates", {"dr/ekf": (PARAMETER,)}, 0.0)
    with pytest.raises(OutputError, match=r"cannot write: No space left"), context as table:
        table.write(*block(0, 10))
    assert len(RunFolder(tmp_path).places[0]) == 10


def test_a_folder_that_has_a_table_is_left_alone(tmp_path):
    (tmp_path / "estimates.arrows").write_bytes(b"kept")
    context = estimates_parquet.estimates_parquet(tmp_path / "estimates", {}, 0.0)
    with pytest.raises(OutputError, match="File exists"), context:
        pass
    assert (tmp_path / "estimates.arrows").read_bytes() == b"kept"


def test_without_pyarrow_a_check_says_what_to_install(palpate, point_pipeline, monkeypatch):
    found = importlib.util.find_spec
    spec = "palpate_kit.runs.estimates_settings.find_spec"
    monkeypatch.setattr(spec, lambda name: None if name == "pyarrow" else found(name))
    done = palpate("check", point_pipeline, "--set", "estimates.format=parquet")
    assert done.returncode == 2
    assert 'pip install "palpate[parquet]"' in done.stderr


@pytest.mark.slow
def test_replay_and_report_of_a_run_in_parquet(palpate, run_point, tmp_path):
    result = run_point("trajectory.press.duration=2 s", "estimates.format=parquet")
    done = palpate("replay", result.folder, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    (one,), (again,) = RunFolder(result.folder).tables, RunFolder(tmp_path / "again").tables
    assert again.path.name == "estimates.parquet"
    np.testing.assert_array_equal(again.numbers, one.numbers)
    shutil.copytree(result.folder, tmp_path / "killed", ignore=shutil.ignore_patterns("result.json"))
    done = palpate("report", tmp_path / "killed")
    assert done.returncode == 0, done.stderr


def test_a_damaged_table_is_never_other_numbers(tmp_path):
    """Every page has a checksum: of one flipped bit without them every fifth gave other numbers."""
    with estimates_parquet.estimates_parquet(tmp_path / "estimates", {"dr/ekf": (PARAMETER,)}, 0.0) as table:
        table.write(*block(0, 500))
    path = tmp_path / "estimates.parquet"
    (whole,) = RunFolder(tmp_path).tables
    raw, refused = path.read_bytes(), 0
    for at in range(4, len(raw), len(raw) // 30):
        path.write_bytes(raw[:at] + bytes([raw[at] ^ 4]) + raw[at + 1 :])
        try:
            (found,) = RunFolder(tmp_path).tables
            np.testing.assert_array_equal(found.numbers, whole.numbers)
        except LogError:
            refused += 1
    assert refused > 20
