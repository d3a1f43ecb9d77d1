"""Whole runs with the page: what it costs them, how it stops them, and what it shows of those that are recorded."""

import os
import queue
import signal
import threading

import numpy as np
import pytest
from palpate_live import sink, watch_command
from websockets.sync.client import connect

from tests.live_page.conftest import read

PAGE = 'sink.page.type="live"'


@pytest.fixture
def addresses(monkeypatch):
    """Where pages are, as they are said."""
    said = queue.Queue()
    for module in (sink, watch_command):
        monkeypatch.setattr(module, "say", lambda text: said.put(text.removeprefix("live page: ")))
    return said


def opened(address):
    """The page's WebSocket as a browser opens it."""
    where = address.removeprefix("http://")
    origin = f"http://{where.split('/')[0]}"
    return connect(f"ws://{where}data", origin=origin, compression=None, max_size=None)


def meanwhile(work):
    """Do something beside a run; a function that waits for it and gives what came out."""
    found = queue.Queue()

    def do():
        try:
            found.put((work(), None))
        except BaseException as error:  # it is raised where somebody hears it
            found.put((None, error))

    threading.Thread(target=do, daemon=True).start()

    def wait():
        answer, error = found.get(timeout=60)
        if error is not None:
            raise error
        return answer

    return wait


@pytest.mark.slow
def test_stop_on_the_page_retracts_the_arm(run_live, stage, addresses):
    def press():
        with opened(addresses.get(timeout=60)) as page:
            while read(page, "guard")[0]["phase"] != "motion":
                pass
            page.send("stop")
            tripped = read(page, "guard")[0]
            found = read(page, "found")[0]
            while not found["final"]:
                found = read(page, "found")[0]
            read(page, "over")
            return tripped

    wait = meanwhile(press)
    result = run_live(PAGE, "trajectory.press.duration=60 s")
    tripped = wait()
    assert tripped["phase"] == "tripped"
    assert (
        tripped["reason"] == result.interrupted == "stopped: on the live page; the result is what was found until then"
    )
    assert stage.LINKS[-1].stops[0][1] == "retract"
    assert result.run["log_duration"] < 30
    assert addresses.empty()  # nothing was dropped


@pytest.mark.slow
def test_the_page_is_told_all_of_a_live_run(run_live, addresses):
    def look():
        kinds, tracks = set(), set()
        with opened(addresses.get(timeout=60)) as page:
            run = read(page, "run")[0]
            while "over" not in kinds:
                header, _ = read_any(page)
                kinds.add(header["kind"])
                tracks |= {header["track"]} if header["kind"] == "found" else set()
        return run, kinds, tracks

    wait = meanwhile(look)
    result = run_live(PAGE)
    run, kinds, tracks = wait()
    assert run["duration"] == pytest.approx(result.run["log_duration"], abs=1.5)
    assert kinds == {"rows", "health", "found", "flags", "guard", "result", "over"}
    assert tracks == {"dr/ekf"}


def read_any(page):
    from palpate_kit.page.datagrams import unpack

    said = page.recv(timeout=60)
    return unpack(said.encode() if isinstance(said, str) else said)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_run_ends_as_ever_though_its_page_stands_still_or_dies(how, run_live, addresses, monkeypatch):
    pids = []
    made = sink.PageServer.__init__

    def noted(self, *arguments, **more):
        made(self, *arguments, **more)
        pids.append(self.pid)
        os.kill(self.pid, how)

    monkeypatch.setattr(sink.PageServer, "__init__", noted)
    result = run_live(PAGE)
    assert result.interrupted is None
    assert result.tracks["dr/ekf"].samples > 100
    addresses.get()
    if how == signal.SIGKILL:
        assert "ended from outside; the run did not wait" in addresses.get()
    with pytest.raises(ProcessLookupError):  # nothing is left behind
        os.kill(pids[0], 0)


@pytest.mark.slow
def test_a_simulated_run_with_the_page_finds_the_same(run_point, addresses):
    plain, shown = run_point(name="plain"), run_point(PAGE, name="shown")
    table, other = plain.table(), shown.table()
    for found in (table, other):
        found["tracks"]["dr/ekf"].pop("seconds_per_sample")
    assert table["tracks"] == other["tracks"]
    assert (plain.folder / "estimates.csv").read_bytes() == (shown.folder / "estimates.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("log", [True, False], ids=["by its log", "by its tables"])
def test_a_recorded_run_is_watched(log, run_point, addresses, monkeypatch):
    offline = [] if log else ['run.tracks=["dr/ekf", "dr/smoother"]', 'estimator.smoother.type="kinematic-smoother"']
    folder = run_point("trajectory.press.duration=3 s", *offline, name="watched").folder
    if not log:
        (folder / "log.mcap").unlink()
    stop = threading.Event()
    monkeypatch.setattr(watch_command.PageServer, "wait", lambda self: stop.wait(60))

    def look():
        if not log:
            assert "table of estimates" in addresses.get(timeout=60)
        with opened(addresses.get(timeout=60)) as page:
            assert "Ctrl-C" in addresses.get(timeout=60)
            run, (time, columns) = read(page, "run")[0], read(page, "rows")[1]
            found = []
            while (header := read_any(page)[0])["kind"] != "result":
                found.append(header)
        stop.set()
        return run, time, columns, found

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
    assert run["tracks"][0]["name"] == "dr/ekf"
    assert time[-1] == pytest.approx(6.0, abs=0.5)
    assert columns[0].max() > 3.0
    assert sorted(folder.iterdir()) == before  # nothing was written


def test_a_run_without_a_log_is_not_estimated_once_more(run_point, palpate, tmp_path):
    folder = run_point("trajectory.press.duration=1 s", name="bare").folder
    (folder / "log.mcap").unlink()
    done = palpate("watch", folder, "--set", "alignment.tip_mass=100 g")
    assert (done.returncode, "no log to estimate again" in done.stderr) == (2, True)
    (folder / "result.json").unlink()
    done = palpate("watch", folder)
    assert (done.returncode, "neither a log nor a result" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["nowhere"], "there is no such file"), (["samples.csv"], "carries no pipeline"), (["empty.mcap"], "empty.mcap")],
)
def test_what_cannot_be_watched_is_said(arguments, said, palpate, tmp_path):
    (tmp_path / "samples.csv").write_text("t,z,f\n0,0,0\n1,0,0\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    done = palpate("watch", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_option_is_the_sink(palpate, point_pipeline):
    done = palpate("run", point_pipeline, "--live", "--set", "trajectory.press.duration=1 s", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "live page: http://127.0.0.1:" in done.stderr
    wrong = palpate("run", point_pipeline, "--live", "--set", "sink.live.port=70000")
    assert wrong.returncode == 2
    assert "sink.live" in wrong.stderr
    assert "65535" in wrong.stderr


@pytest.mark.slow
def test_writers_are_told_what_a_track_would_find(run_live, stage):
    """As the result has it in the end, flags judged; nothing of it changes the run."""
    result = run_live()
    told = stage.LISTENERS[-1]
    tracks = [health["tracks"] for (health,) in told.of("health")]
    ours, theirs = tracks[-1]["dr/ekf"]["parameters"], result.tracks["dr/ekf"].table()["parameters"]
    for name in ours:
        assert ours[name]["value"] == theirs[name]["value"]
        assert ours[name]["settling"] == theirs[name]["settling"]
        assert theirs[name]["combined"] >= ours[name]["combined"] > ours[name]["std"]
    assert tracks[0] == {}  # before it has begun
    flags = [flag for _, flags in told.of("flags") for flag in flags]
    assert flags
    assert all(flag.severity for flag in flags)
