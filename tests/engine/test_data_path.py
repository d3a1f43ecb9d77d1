"""The data path: what writers are told, in which order, and what they can ask for."""

import csv
import itertools
import json
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from palpate.sink import TakesFlags, TakesGuard, TakesHealth, TakesResult
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.pipeline.live import live_flow

from tests.engine.live import EVENTS, LINKS, LISTENERS

SHORT = ("trajectory.press.duration=1 s", 'run.tracks=["*/ekf"]')


def test_a_sink_knows_name_duration_and_extent_and_gets_the_result_last(point_pipeline, tmp_path, kept):
    pipeline = load_pipeline(point_pipeline, [*SHORT, *kept])
    result = run_pipeline(pipeline, tmp_path / "out")
    (listener,) = LISTENERS
    run = listener.run
    assert run.name == "S2, simulated"
    assert run.duration == next(iter(pipeline.trajectories.values())).total_duration
    (x, y, low), (_, _, high) = run.extent
    assert (x, y) == (0.0, 0.0)
    assert low == pytest.approx(-0.005, abs=2e-5)
    assert high == pytest.approx(0.005, abs=2e-5)
    assert listener.heard[-1][0] == "result"
    assert listener.of("result") == [[result.table()]]
    assert json.loads(json.dumps(result.table())) == json.loads((tmp_path / "out" / "result.json").read_text())
    assert EVENTS == ["open", "close"]


def test_what_is_recorded_comes_before_its_samples_and_these_before_their_estimates(point_pipeline, tmp_path, kept):
    run_pipeline(load_pipeline(point_pipeline, [*SHORT, *kept]), tmp_path / "out")
    names = [entry[0] for entry in LISTENERS[0].heard]
    first = {name: names.index(name) for name in ("batch", "samples", "estimates")}
    assert first["batch"] < first["samples"] < first["estimates"]
    blocks = [i for i, name in enumerate(names) if name == "samples"]
    assert all(names[i + 1] == "estimates" for i in blocks)
    assert all(len(LISTENERS[0].heard[i][1]) == len(LISTENERS[0].heard[i + 1][2]) for i in blocks)


@pytest.mark.gate
@pytest.mark.slow
def test_flags_are_told_as_they_rise_and_as_they_fall(point_pipeline, tmp_path, kept, monkeypatch):
    monkeypatch.setattr("palpate_engine.pipeline.health._INTERVAL", 0.0)
    pipeline = load_pipeline(point_pipeline, [*SHORT, *kept, "trajectory.press.duration=14 s"])
    result = run_pipeline(pipeline, tmp_path / "out")
    told = [{flag.code for flag in flags} for track, flags in LISTENERS[0].of("flags") if track == "dr/ekf"]
    assert "not-converged" in told[0]
    assert set().union(*told) > told[-1]  # one of them has fallen
    assert told[-1] <= {flag["code"] for flag in result.table()["tracks"]["dr/ekf"]["flags"]}
    assert all(before != after for before, after in itertools.pairwise(told))


def test_a_writer_that_wants_nothing_more_is_asked_for_nothing_more(point_pipeline, tmp_path):
    class Plain:
        batch = samples = estimates = staticmethod(lambda *values: None)

    assert not isinstance(Plain(), TakesHealth | TakesFlags | TakesGuard | TakesResult)
    run_pipeline(load_pipeline(point_pipeline, SHORT), tmp_path / "out", observer=Plain())


@pytest.mark.gate
@pytest.mark.slow
def test_a_sink_ends_a_live_run_through_the_guard(run_live):
    """The arm is told within the call, not when the next batch comes; the result says why."""
    told = []

    def press():
        while not LISTENERS or not any(samples.active.any() for (samples,) in LISTENERS[0].of("samples")):
            time.sleep(0.01)
        LISTENERS[0].run.stop("the button on the page")
        told.extend(LINKS[0].stops)

    thread = threading.Thread(target=press)
    thread.start()
    result = run_live("trajectory.press.duration=20 s")
    thread.join()
    assert [what for _, what in told] == ["retract"]
    assert "the button on the page" in result.interrupted
    assert [state.phase for (state,) in LISTENERS[0].of("guard")] == ["standstill", "motion", "tripped"]
    assert "the button on the page" in LISTENERS[0].of("guard")[-1][0].reason
    health = LISTENERS[0].of("health")[-1][0]
    assert health["time"] > 0.2
    assert health["streams"]["rig.wrench"]["rate"] == pytest.approx(500.0, rel=0.05)
    assert health["tare"]["noise"] == pytest.approx(0.02, rel=0.5)


@pytest.mark.gate
@pytest.mark.slow
def test_sinks_open_before_real_time_scheduling_and_can_start_processes_there(run_live, monkeypatch):
    usual = live_flow.real_time_section

    @contextmanager
    def noted(stop):
        EVENTS.append("undisturbed")
        with usual(stop) as said:
            yield said

    monkeypatch.setattr(live_flow, "real_time_section", noted)
    run_live("trajectory.press.duration=0.3 s")
    assert EVENTS == ["open", "undisturbed", "close"]


@pytest.mark.gate
@pytest.mark.slow
def test_innovations_are_in_the_table_and_in_the_log(run_point):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    result = run_point("trajectory.press.duration=4 s", "run.estimates_interval=0 s", 'sink.log.type="mcap"')
    with (result.folder / "estimates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = np.array([float(row["dr/ekf:innovation"] or "nan") for row in rows])
    with (result.folder / "log.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        logged = [m.innovation for *_, m in reader.iter_decoded_messages(topics=["/palpate/estimates/dr/ekf"])]
    np.testing.assert_allclose(table, logged, rtol=1e-9)
    tracked = np.array([bool(row["dr/ekf:nis"]) for row in rows])
    late = table[tracked][-500:]
    assert abs(late.mean()) < 0.3
    assert late.std() == pytest.approx(1.0, abs=0.3)
