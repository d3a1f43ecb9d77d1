"""`palpate replay watch`: what the page shows of runs that are recorded."""

import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
from palpate_engine import load_pipeline, run_pipeline
from palpate_live import watch_command

from tests.live_page.conftest import meanwhile, opened, read_any


@pytest.fixture(scope="module")
def record(root, tmp_path_factory):
    """The folder of a run of 6 s with a filter and its smoother."""
    sets = ["trajectory.press.duration=6 s", 'run.tracks=["dr/ekf", "dr/smoother"]']
    pipeline = load_pipeline(
        root / "pipelines" / "filters.toml", [*sets, 'estimator.smoother.type="kinematic-smoother"']
    )
    return run_pipeline(pipeline, tmp_path_factory.mktemp("record") / "watched").folder


def shown(page):
    """What a page holds in the end, as it puts it together: the run, times, columns; headers of all messages beside."""
    run, time, columns, others = None, [], [], []
    while True:
        header, rows = read_any(page)
        if header["kind"] == "run":  # the record from its beginning, once more where rows have changed
            run, time, columns = header, [], []
        elif header["kind"] == "rows":
            time.append(rows[0])
            columns.append(rows[1])
        elif header["kind"] == "result":
            return run, np.concatenate(time), np.concatenate(columns, axis=1), others
        else:
            others.append(header)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "when"),
    [
        pytest.param(True, "before the first row", marks=pytest.mark.gate),
        (True, "after the last"),
        (False, "before the first row"),
        (False, "after the last"),
    ],
)
def test_a_recorded_run_is_watched(log, when, record, addresses, monkeypatch, tmp_path):
    """A browser that is quick comes before the first row, another when the page has all of the record."""
    folder = Path(shutil.copytree(record, tmp_path / "watched"))
    if not log:
        (folder / "log.mcap").unlink()
    stop, connected = threading.Event(), threading.Event()
    monkeypatch.setattr(watch_command.PageServer, "wait", lambda self: stop.wait(60))
    said = watch_command.say

    def say(text):
        said(text)
        if text.startswith("live page: ") and when == "before the first row":
            assert connected.wait(60)

    monkeypatch.setattr(watch_command, "say", say)

    def look():
        if not log:
            assert "table of estimates" in addresses.get(timeout=60)
        address = addresses.get(timeout=60)
        if when == "after the last":
            assert "Ctrl-C" in addresses.get(timeout=60)
        with opened(address) as page:
            connected.set()
            found = shown(page)
        stop.set()
        return found

    wait = meanwhile(look)
    before = sorted(folder.iterdir())
    watch_command.watch(folder)
    run, time, columns, told = wait()
    if log:
        assert len(told) > 8  # how things stood each second of the record, however fast it was read
    else:
        assert {header["kind"] for header in told} == {"health", "found", "flags"}
    assert [track["name"] for track in run["tracks"]] == ["dr/ekf", "dr/smoother"]
    assert all(np.isfinite(columns[track["begin"]]).any() for track in run["tracks"])
    final = next(header for header in told if header["kind"] == "found" and header["final"])
    value, combined, *_ = final["parameters"]["elasticity"]
    assert 2e4 < value < 3e5
    assert combined > 0
    assert run["recorded"]
    assert len(time) == columns.shape[1]
    assert (np.diff(time) > 0).all()
    assert time[-1] == pytest.approx(9.0, abs=0.5)
    assert columns[0].max() > 3.0
    assert sorted(folder.iterdir()) == before  # nothing was written


def test_a_run_without_a_log_is_not_estimated_once_more(run_point, palpate, tmp_path):
    folder = run_point("trajectory.press.duration=1 s", name="bare").folder
    (folder / "log.mcap").unlink()
    done = palpate("replay", "watch", folder, "--set", "alignment.tip_mass=100 g")
    assert (done.returncode, "no log to estimate again" in done.stderr) == (2, True)
    (folder / "result.json").unlink()
    done = palpate("replay", "watch", folder)
    assert (done.returncode, "neither a log nor a result" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["nowhere"], "no such file"), (["samples.csv"], "carries no pipeline"), (["empty.mcap"], "empty.mcap")],
)
def test_what_cannot_be_watched_is_said(arguments, said, palpate, tmp_path):
    (tmp_path / "samples.csv").write_text("t,z,f\n0,0,0\n1,0,0\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    done = palpate("replay", "watch", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
