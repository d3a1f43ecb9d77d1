"""Whole runs with the page: what it costs them, how it stops them, and what they send it."""

import os
import signal

import pytest
from palpate_kit.runs.result_file import estimate_of
from palpate_live import sink

from tests.live_page.conftest import meanwhile, opened, read, read_any

PAGE = 'sink.page.type="live"'


@pytest.mark.gate
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
    # A busy machine may drop messages, which is said; nothing else is.
    assert all("too slow" in notice for notice in list(addresses.queue))


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
        assert ours[name]["value"] == estimate_of(theirs[name])
        assert ours[name]["settling"] == theirs[name]["settling"]
        assert theirs[name]["combined"] >= ours[name]["combined"] > ours[name]["std"]
    assert tracks[0] == {}  # before it has begun
    flags = [flag for _, flags in told.of("flags") for flag in flags]
    assert flags
    assert all(flag.severity for flag in flags)
