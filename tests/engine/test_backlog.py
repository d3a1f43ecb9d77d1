"""Estimates that do not keep up: recording never waits, the same bits in larger blocks, and it is said."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from palpate import Batch, Channel, Stream
from palpate.estimation import Estimates, Samples
from palpate_engine.alignment import AlignmentSettings, Ports
from palpate_engine.pipeline import data_path as module, run_pipeline
from palpate_engine.pipeline.data_path import Backlog
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.tracks import Tracks, start_tracks

from tests.engine.live import LISTENERS

TIP = Stream("tip", (Channel("z", "m"),), 500.0)
PORT = Ports.of(AlignmentSettings.model_validate({"force": "r.tip.z", "position": "r.tip.z"}), {"r": (TIP,)})[
    "position"
]


def block(begin, count):
    time = np.arange(begin, begin + count) * 0.002
    column, marks = np.zeros(count), np.zeros(count, bool)
    return Samples(np.rint(time * 1e9).astype(np.int64), time, column, column, column, column, marks, marks)


def test_a_replay_gets_all_samples_at_once():
    waiting = Backlog()
    for begin in (0, 100, 20000):
        samples = block(begin, 100)
        assert waiting.next(samples) is samples
        waiting.served(samples)
        assert waiting.behind == 0.0


def test_a_live_run_gets_as_many_as_take_a_slice_of_time_and_in_their_order():
    waiting, seen = Backlog(Latency(PORT)), []
    waiting._sample_cost = 1e-3  # a sample takes a millisecond: fifty in a slice
    due = waiting.next(block(0, 120))
    while len(due):
        assert len(due) <= 50
        seen.append(due)
        waiting.estimated = float(due.time[-1])  # as if estimated in no time
        due = waiting.next(block(0, 0))
    np.testing.assert_array_equal(Samples.joined(seen).time, block(0, 120).time)
    assert waiting.behind == 0.0
    assert waiting.largest == pytest.approx(70 * 0.002)  # what the first slice did not take


def test_a_backlog_that_is_too_long_is_given_up_and_its_samples_are_handed_out(monkeypatch):
    monkeypatch.setattr(module, "_MAX_BEHIND", 1.0)
    waiting = Backlog(Latency(PORT))
    waiting._sample_cost = 1.0
    first = waiting.next(block(0, 100))
    waiting.served(first)
    assert waiting.given_up is None
    everything = waiting.next(block(100, 600))
    assert waiting.given_up == first.time[-1]
    assert len(first) + len(everything) == 700


def test_latency_is_from_arrival_to_estimate(monkeypatch):
    latency = Latency(PORT)
    stamps = np.arange(1000, dtype=np.int64) * 2_000_000
    latency.arrived([("r", Batch("tip", stamps, stamps + 500, np.zeros((1000, 1))))])
    latency.arrived([("r", Batch("other", stamps, stamps, np.zeros((1000, 1))))])
    assert latency.table() is None
    monkeypatch.setattr("palpate_engine.pipeline.latency.host_time_ns", lambda: int(stamps[989]) + 500 + 5_000_000)
    latency.served(stamps[980:990])
    table = latency.table()
    assert table["max"] == pytest.approx(989 * 0.002 + 0.005)
    assert table["p50"] == pytest.approx(495 * 0.002 + 0.005, rel=0.08)
    latency.served(stamps[990:])
    assert latency.table()["max"] == table["max"]
    assert int(latency._counts.sum()) == 1000


@pytest.fixture
def slow(monkeypatch):
    """Estimating takes so long for each sample [s]."""
    estimate, state = Tracks.estimate, {"seconds": 0.0}

    def slowly(self, samples):
        time.sleep(state["seconds"] * len(samples))
        return estimate(self, samples)

    monkeypatch.setattr(Tracks, "estimate", slowly)
    return state


@pytest.fixture
def replay(live_pipeline, tmp_path):
    """Run the live pipeline on its log."""

    def run(log):
        path = tmp_path / "live.toml"
        text = path.read_text().replace('type = "live"', f'type = "mcap-replay"\nfile = "{log}"\nrecorded = "rig"')
        path.write_text(text)
        return run_pipeline(live_pipeline(), tmp_path / "again")

    return run


def heard(name):
    return LISTENERS[-1].of(name)


@pytest.mark.gate
@pytest.mark.slow
def test_estimates_that_lag_are_all_made_with_the_same_bits_and_flagged(run_live, live_pipeline, slow):
    slow["seconds"] = 0.004  # twice as long as the samples take to come
    shown = []
    result = run_live("trajectory.press.duration=0.3 s", progress=lambda now, total, behind: shown.append(behind))
    assert max(shown) > 0.5
    assert shown[-1] == 0.0
    facts = result.run["live"]["estimates"]
    assert facts["largest_behind"] == pytest.approx(max(shown), abs=0.3)
    assert facts["until"] is None
    assert facts["latency"]["p50"] <= facts["latency"]["p99"] <= facts["latency"]["max"]
    assert (facts["largest_behind"] > 1.0) == ("backlog" in [flag.code for flag in result.flags])
    assert result.interrupted is None
    samples = Samples.joined([block for (block,) in heard("samples")])
    recorded = sum(len(batch.time) for _, batch in heard("batch") if batch.stream == "tip")
    assert recorded >= len(samples) > 500
    assert len(heard("samples")) > 10
    (track,) = start_tracks(live_pipeline())
    whole = track.tracker.run(samples)
    found = [estimates for _, estimates in heard("estimates")]
    for name in ("values", "std", "surface", "nis", "innovation", "status"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in found]), getattr(whole, name))


@pytest.mark.slow
def test_a_run_that_keeps_up_says_how_late_its_estimates_are(run_live):
    result = run_live("trajectory.press.duration=0.3 s")
    facts = result.run["live"]["estimates"]
    assert facts["latency"]["p50"] > 0
    assert "backlog" not in [flag.code for flag in result.flags]


@pytest.mark.gate
@pytest.mark.slow
def test_a_stopped_run_does_not_wait_for_its_backlog(run_live, replay, slow):
    """The backlog is written as samples, the result says until when there are estimates."""
    slow["seconds"] = 0.01

    def press():
        while not LISTENERS or not heard("estimates") or heard("samples")[-1][0].time[-1] < 0.3:
            time.sleep(0.01)
        time.sleep(1.0)
        stopped.append(time.monotonic())
        LISTENERS[-1].run.stop("enough")

    stopped = []
    thread = threading.Thread(target=press)
    thread.start()
    result = run_live("trajectory.press.duration=20 s", 'sink.log.type="mcap"')
    took = time.monotonic() - stopped[0]
    thread.join()
    assert took < 4.0  # 2 s, and what a busy machine adds
    until = result.run["live"]["estimates"]["until"]
    samples = Samples.joined([block for (block,) in heard("samples")])
    estimates = np.concatenate([estimates.time for _, estimates in heard("estimates")])
    assert until == pytest.approx(estimates[-1])
    assert samples.time[-1] > until + 0.5
    np.testing.assert_array_equal(estimates, samples.time[: len(estimates)])
    assert isinstance(heard("estimates")[0][1], Estimates)
    last = (result.folder / "estimates.csv").read_text().splitlines()[-1]
    assert float(last.split(",")[0]) <= until
    with (result.folder / "log.mcap").open("rb") as file:
        marked = {entry.name: entry.metadata for entry in make_reader(file).iter_metadata()}
    assert marked["palpate result"] == {"estimated_until": f"{until:.6f}"}
    slow["seconds"] = 0.0
    replayed = replay(result.folder / "log.mcap")
    rows, again = ((folder / "estimates.csv").read_text().splitlines() for folder in (result.folder, replayed.folder))
    assert len(again) > len(rows) > 10
    assert again[: len(rows)] == rows
    assert f"end at {until:.2f} s" in next(flag.message for flag in result.flags if flag.code == "backlog")


@pytest.mark.slow
def test_a_recording_without_tracks_has_no_estimates_that_could_lag(live_pipeline, tmp_path, slow):
    slow["seconds"] = 0.004
    pipeline = replace(live_pipeline("trajectory.press.duration=0.3 s"), tracks=())
    result = run_pipeline(pipeline, tmp_path / "out")
    assert "estimates" not in result.run["live"]
    assert [flag.code for flag in result.flags if flag.code == "backlog"] == []
