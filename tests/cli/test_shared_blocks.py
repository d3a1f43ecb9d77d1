"""A third party's plugin cannot change the numbers of others: what all plugins share is read-only."""

import json
from dataclasses import fields

import numpy as np
import pytest
from palpate import Batch, Estimates, Samples
from palpate.device import Channel, Stream
from palpate.errors import error_in
from palpate.vectors import read_only
from palpate_engine.pipeline.arrivals import declared_batches

FILTER = """
import numpy as np
from palpate import Estimates, Estimator, plugin


class Own(Estimator):
    '''Changes the samples.'''

    def start(self, problem):
        '''A tracker.'''
        return Tracker()


class Tracker:
    '''At work.'''

    def run(self, s):
        '''Estimates.'''
        {body}
        return Estimates.idle(s, 2)


@plugin
def palpate_estimators():
    return {{"own": Own}}
"""
SINK = """
from contextlib import contextmanager

from palpate import Sink, plugin


class Own(Sink):
    '''Changes what it is to write.'''

    @contextmanager
    def open(self, run):
        '''A writer.'''
        yield Writer()


class Writer:
    '''An open sink.'''

    def batch(self, device, batch):
        '''Readings.'''
        {batch}

    def samples(self, samples):
        '''Samples.'''
        {samples}

    def estimates(self, track, estimates):
        '''Estimates.'''
        {estimates}


@plugin
def palpate_sinks():
    return {{"own": Own}}
"""
JUDGES = """
from palpate import Diagnosed, Diagnosis, Summary, plugin


def judge(tracks):
    for track in tracks:
        {judge}
    return {{}}


class Places:
    '''A summary.'''

    def add(self, samples, estimates):
        '''Takes in a block.'''
        {add}

    def of(self, result, model, is_sweep):
        '''The result as it is.'''
        return result


@plugin
def palpate_diagnoses():
    return {{"own-judge": Diagnosis(judge)}}


@plugin
def palpate_offers():
    return {{"summary": {{"own-places": Summary(Places)}}}}
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A simulated press of two seconds, a fit of it, and the numbers of that fit."""
    from tests import command
    from tests.conftest import ROOT

    folder = tmp_path_factory.mktemp("record")
    text = (ROOT / "pipelines" / "point.toml").read_text().replace('duration = "10 s"', 'duration = "2 s"')
    text += '\n[estimator.fit]\ntype = "casadi-fit"\n'
    (folder / "point.toml").write_text(text)
    done = command.call("run", "point.toml", "--out", "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    return text, json.loads((folder / "out" / "result.json").read_text())["tracks"]


@pytest.fixture
def run(record, palpate, tmp_path):
    """Run the press with a plugin and more tables; the command, and its tracks."""
    text, _ = record

    def with_plugin(plugin, tables=""):
        (tmp_path / "own.py").write_text(plugin)
        (tmp_path / "point.toml").write_text(text.replace("[run]\n", '[run]\nplugins = ["own.py"]\n', 1) + tables)
        done = palpate("run", "point.toml", "--out", "out")
        return done, json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]

    return with_plugin


def estimates_of(track):
    """Value and standard deviation of each parameter, determined or not."""
    return {key: (value.get("estimate", value["value"]), value["std"]) for key, value in track["parameters"].items()}


def numbers(track):
    """Values, uncertainties, verdict, findings and conditions of a track."""
    return {key: track[key] for key in ("verdict", "samples", "parameters", "surface", "nis", "flags", "conditions")}


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("body", ["s.force -= 0.05", "s.force[:] = 0.0", "np.multiply(s.position, 2, out=s.position)"])
def test_a_filter_that_writes_to_the_samples_ends_its_track_and_changes_no_other(run, record, body):
    done, tracks = run(FILTER.format(body=body), '\n[estimator.own]\ntype = "own"\n')
    assert done.returncode == 1, done.stderr
    for name, track in record[1].items():
        assert numbers(tracks[name]) == numbers(track)
    (flag,) = [flag for flag in tracks["dr/own"]["flags"] if flag["code"] == "failed"]
    assert "estimator 'own' of plugin own.py failed" in flag["message"]
    assert "read-only (own.py, line 19, in run)" in flag["message"]
    assert "change a copy" in flag["message"]
    assert "estimator 'own' of plugin own.py failed" in " ".join(done.stderr.split())


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("written", "place"),
    [
        ({"batch": "batch.values[:] = 0.0"}, ", in batch)"),
        ({"samples": "samples.force[:] = 0.0"}, ", in samples)"),
        ({"estimates": "estimates.values[:] = 1.0"}, ", in estimates)"),
    ],
)
def test_a_sink_that_writes_to_what_it_is_to_store_is_named(run, written, place):
    plugin = SINK.format(**({"batch": "pass", "samples": "pass", "estimates": "pass"} | written))
    done, tracks = run(plugin, '\n[sink.own]\ntype = "own"\n')
    assert done.returncode == 2
    assert "plugin own.py failed: ValueError: assignment destination is read-only" in done.stderr
    assert place in done.stderr
    assert "Traceback" not in done.stderr
    assert "interrupted" in {flag["code"] for flag in tracks["dr/fit"]["flags"]}


@pytest.mark.gate
@pytest.mark.slow
def test_diagnoses_and_summaries_that_write_are_named_and_change_no_number(run, record):
    judge = "track.kept.force[:] = 0.0"
    done, tracks = run(JUDGES.format(judge=judge, add="estimates.values[:] = 0.0"))
    assert done.returncode == 0, done.stderr
    for name, track in record[1].items():
        (flag,) = [flag for flag in tracks[name]["flags"] if flag["code"] == "diagnosis-failed"]
        assert (
            "own-judge: ValueError: assignment destination is read-only (own.py, line 7, in judge)" in flag["message"]
        )
        assert "summary own-places: ValueError" in flag["message"]
        assert estimates_of(tracks[name]) == estimates_of(track)


def some_samples(count=6):
    """Samples of a tip in contact."""
    stamp = np.arange(count) * 2_000_000
    ones, always = np.ones(count), np.ones(count, bool)
    return Samples(stamp, stamp / 1e9, 0.002 * ones, ones.copy(), -1e-3 * ones, 0 * ones, always, always.copy())


@pytest.mark.parametrize("name", [field.name for field in fields(Samples)])
def test_no_column_of_a_shared_block_can_be_written_to(name):
    own = some_samples()
    shared = read_only(own)
    for block in (shared, shared[1:3], Samples.joined([shared, shared])):
        with pytest.raises(ValueError, match="read-only"):
            getattr(block, name)[0] = 1
    assert np.array_equal(getattr(shared, name), getattr(own, name), equal_nan=name in ("lateral", "curvature"))
    own.force[0] = 7.0  # what its maker owns stays writable
    assert shared.force[0] == 7.0


def test_batches_of_a_device_are_read_only():
    class Link:
        def batches(self):
            yield Batch("s", np.arange(3), np.arange(3), np.zeros((3, 1)))

    (batch,) = declared_batches("rig", Link(), (Stream("s", (Channel("z", "m"),), 500.0),))
    for column in (batch.time, batch.received, batch.values):
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 1


@pytest.mark.parametrize(
    ("act", "is_write"),
    [
        (lambda samples: samples.force.sort(), True),
        (lambda samples: setattr(samples, "force", 0.0), True),
        (lambda samples: samples.force[99], False),
    ],
)
def test_an_error_of_writing_says_what_to_do(act, is_write):
    with pytest.raises(Exception, match=r".") as error:
        act(read_only(some_samples()))
    assert ("change a copy" in error_in(error.value)) == is_write


def test_estimates_of_a_tracker_are_read_only():
    from palpate_engine.pipeline.plugin_failure import check_estimates

    own = Estimates.idle(some_samples(), 2)
    shared = check_estimates(own, some_samples(), 2)
    with pytest.raises(ValueError, match="read-only"):
        shared.values[0] = 1.0
    own.values[0] = 1.0
