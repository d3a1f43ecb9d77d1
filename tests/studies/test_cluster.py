"""Sweeps on the workers of a scheduler: the same table as here, nothing twice, nothing lost, other versions refused."""

import json
import os
import re
import signal
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest
from palpate import ConfigurationError, UserError
from palpate.host import RunFolder

distributed = pytest.importorskip("distributed")
from palpate_studies import cluster, workers  # noqa: E402
from palpate_studies.jobs import Job, on_all_cores  # noqa: E402

pytestmark = [
    pytest.mark.filterwarnings("ignore"),  # of dask's own, when workers die
    pytest.mark.xdist_group("cluster"),  # one cluster for all
]


@pytest.fixture(autouse=True)
def no_long_waiting(monkeypatch):
    monkeypatch.setattr(workers, "_WITHOUT", 60.0)


@pytest.fixture(scope="module")
def scheduler():
    """Two workers on this machine; by address, as any others. They import what this file sends them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as running:
            yield running.scheduler_address


def _jobs(pipeline, folder, count):
    text = pipeline.read_text().replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1)
    folder.mkdir(exist_ok=True)
    short = ("trajectory.press.duration=1 s",)
    return [
        Job(n, text, str(pipeline), (*short, f"run.seed={n}"), {"run.seed": n}, str(folder))
        for n in range(1, count + 1)
    ]


def _found(engine, jobs):
    with closing(engine(jobs)) as running:
        return {job.number: result for job, result in running}


def _numbers(found):
    """What was found, without how long it took."""
    tracks = {(n, name): track for n, result in found.items() for name, track in result["tracks"].items()}
    return {key: {**track, "seconds_per_sample": None} for key, track in tracks.items()}


def test_results_are_those_of_this_machine_to_the_bit(scheduler, point_pipeline, tmp_path):
    here = _found(lambda jobs: on_all_cores(jobs, 1), _jobs(point_pipeline, tmp_path / "here", 3))
    jobs = _jobs(point_pipeline, tmp_path / "there", 3)
    there = _found(cluster.on_cluster(scheduler, tmp_path / "there"), jobs)
    assert _numbers(there) == _numbers(here)
    assert len(here) == 3
    for number in here:
        one, other = (tmp_path / place / f"{number:05d}" / "estimates.csv" for place in ("here", "there"))
        assert one.read_bytes() == other.read_bytes()
    told = json.loads((tmp_path / "there" / "workers.json").read_text())
    assert told["equal"] == "to the bit"
    assert len(told["workers"]) == 2
    assert not [path for path in (tmp_path / "there").iterdir() if path.name.startswith(".")]


def test_nothing_is_computed_twice(scheduler, point_pipeline, tmp_path):
    engine = cluster.on_cluster(scheduler, tmp_path / "runs")
    jobs = _jobs(point_pipeline, tmp_path / "runs", 2)
    first = _found(engine, jobs)
    assert _found(engine, jobs) == first  # an answer that was lost is found in the folder
    assert sorted(path.name for path in (tmp_path / "runs").glob("0*")) == ["00001", "00002"]


def _die_once(task):
    """Kill the worker the first time; what was done and lost its answer with the worker is found."""
    folder, number = task
    if (folder / f"{number}").exists():
        return number
    if number == 2 and not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    (folder / f"{number}").open("a").write("done\n")
    return number


def _die(task):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_worker_loses_nothing(scheduler, tmp_path):
    with distributed.Client(scheduler, set_as_default=False) as client:
        tasks = [(tmp_path, number) for number in range(8)]
        found = [outcome for _, outcome in cluster.spread(client, _die_once, tasks)]
        assert sorted(found) == list(range(8))
        assert all((tmp_path / str(n)).read_text() == "done\n" for n in range(8))
        ((_, outcome),) = cluster.spread(client, _die, ["x"])
    assert "killed several times" in cluster._reason(outcome)


def test_workers_of_other_versions_are_refused(scheduler, monkeypatch):
    real = workers.machine()
    monkeypatch.setattr(workers, "machine", lambda: {**real, "casadi": "1.0"})

    class Workers:
        def run(self, function, workers=None):
            return {"tcp://10.0.0.7:1": real}

    with pytest.raises(
        ConfigurationError, match=rf"worker tcp://10.0.0.7:1 has casadi {real['casadi']}, and here is 1.0"
    ):
        workers.demand_alike(Workers(), scheduler)


def test_a_folder_that_workers_do_not_see_is_refused(tmp_path):
    class Workers:
        def run(self, function, path):
            return {"tcp://10.0.0.7:1": function(path), "tcp://10.0.0.8:1": False}

    with pytest.raises(ConfigurationError, match=r"worker tcp://10.0.0.8:1 does not see this folder"):
        cluster._demand_shared(Workers(), tmp_path)
    assert not list(tmp_path.iterdir())


def test_fits_of_several_logs_are_those_of_this_machine(scheduler, palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    files = [tmp_path / "one.toml", tmp_path / "two.toml"]
    for seed, file in enumerate(files, start=1):
        file.write_text(text.replace("seed = 1\n", f"seed = {seed}\n") + '[estimator.fit]\ntype = "casadi-fit"\n')
    found = []
    for place, more in (("here", ()), ("there", ("--scheduler", scheduler))):
        done = palpate("fit", *files, "--no-pictures", "--out", tmp_path / place, *more)
        assert done.returncode == 0, done.stderr
        logs = json.loads((tmp_path / place / "fit.json").read_text())["logs"]
        found.append({name: {**log["tracks"]["dr/fit"], "seconds_per_sample": None} for name, log in logs.items()})
    assert list(found[0]) == list(found[1]) == ["one", "two"]
    assert found[0] == found[1]


def test_no_scheduler_and_both_options_are_mistakes_of_the_user(palpate, point_pipeline, monkeypatch, tmp_path):
    point_pipeline.write_text(point_pipeline.read_text() + '[sweep]\n"run.seed" = [1, 2]\n')
    done = palpate("sweep", point_pipeline, "--jobs", 2, "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "a")
    assert done.returncode == 2
    assert "--jobs is of this machine" in done.stderr
    monkeypatch.setattr(cluster, "_PATIENCE", "1s")
    done = palpate("sweep", point_pipeline, "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "b")
    assert done.returncode == 2
    assert "no scheduler answers there" in done.stderr
    assert not RunFolder(tmp_path / "b").finished


def _slow(task):
    time.sleep(task)
    return task


@pytest.fixture
def own_cluster():
    """A scheduler whose workers a test can send away."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
        ) as running:
            yield running


def test_where_all_workers_are_gone_it_is_told_and_then_an_end(own_cluster, monkeypatch, capsys):
    for name, seconds in (("_AGAIN", 0.05), ("_TELL", 0.2), ("_WITHOUT", 0.9)):
        monkeypatch.setattr(workers, name, seconds)
    with distributed.Client(own_cluster.scheduler_address, set_as_default=False) as client:
        running = cluster.spread(client, _slow, [0.0, 0.0])
        assert next(running) == (0.0, 0.0)  # what is done has been handed over
        own_cluster.scale(0)
        with pytest.raises(
            UserError, match=r"there has been no worker for 1 s, and nobody else has come; what is fini"
        ):
            list(cluster.spread(client, _slow, [0.0, 0.0, 0.0]))
    told = capsys.readouterr().err.splitlines()
    assert len(told) >= 2
    assert re.match(r"there has been no worker since \d\d:\d\d:\d\d: start some, such as `dask worker ", told[0])


def test_workers_that_come_later_go_on_and_are_looked_at(own_cluster, monkeypatch):
    monkeypatch.setattr(workers, "_AGAIN", 0.05)
    looked = []
    monkeypatch.setattr(workers, "demand_alike", lambda client, address, only: looked.extend(only))
    with distributed.Client(own_cluster.scheduler_address, set_as_default=False) as client:
        own_cluster.scale(0)
        running = cluster.spread(client, _slow, [0.0] * 6)
        threading.Timer(0.5, lambda: own_cluster.scale(2)).start()
        assert len(list(running)) == 6
    assert looked


def test_repeats_compare_and_reproduction_are_those_of_this_machine(scheduler, palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    file = tmp_path / "own.toml"
    file.write_text(text.replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1) + "[repeat]\ncount = 2\n")
    commands = {
        "repeat": ("repeat", file, "--track", "dr/ekf"),
        "compare": ("compare", file, "--estimators", "ekf"),
        "reproduce": ("reproduce", "loadcycle"),
    }
    for name, command in commands.items():
        found = {}
        for place, more in (("here", ()), ("there", ("--scheduler", scheduler))):
            done = palpate(*command, "--json", "--out", tmp_path / f"{name}-{place}", *more)
            assert done.returncode == 0, done.stderr
            found[place] = _plain(json.loads(done.stdout))
        assert found["here"] == found["there"]


def _plain(document):
    """A document without what is of one run: times, places."""
    if isinstance(document, dict):
        own = ("folder", "seconds_per_sample", "started", "duration", "command", "host", "pipeline")
        return {key: _plain(value) for key, value in document.items() if key not in own}
    return [_plain(value) for value in document] if isinstance(document, list) else document


def test_an_arm_is_not_repeated_on_a_cluster(palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('type = "sim"', 'type = "sim"\npace = "real-time"', 1)
    point_pipeline.write_text(text + "[repeat]\ncount = 3\n")
    done = palpate("repeat", point_pipeline, "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "--scheduler is for simulations that keep no clock" in done.stderr
    assert not (tmp_path / "out").exists()
