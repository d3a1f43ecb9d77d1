"""Sweeps on the workers of a scheduler: the same table as here, nothing twice, nothing lost, other versions refused."""

import json
import os
import signal
from contextlib import closing
from pathlib import Path

import pytest
from palpate import ConfigurationError
from palpate.host import RunFolder

distributed = pytest.importorskip("distributed")
from palpate_studies import cluster  # noqa: E402
from palpate_studies.jobs import Job, on_all_cores  # noqa: E402

pytestmark = [
    pytest.mark.filterwarnings("ignore"),  # of dask's own, when workers die
    pytest.mark.xdist_group("cluster"),  # one cluster for all
]


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
    real = cluster.machine()
    monkeypatch.setattr(cluster, "machine", lambda: {**real, "casadi": "1.0"})

    class Workers:
        def run(self, function):
            return {"tcp://10.0.0.7:1": real}

    with pytest.raises(
        ConfigurationError, match=rf"worker tcp://10.0.0.7:1 has casadi {real['casadi']}, and here is 1.0"
    ):
        cluster.demand_alike(Workers(), scheduler)


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
