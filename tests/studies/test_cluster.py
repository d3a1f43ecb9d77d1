"""Sweeps on the workers of a scheduler: the same table as here, nothing twice, nothing lost, other versions refused."""

import contextlib
import json
import os
import pickle
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, UserError
from palpate_engine import load_pipeline
from palpate_kit.runs.run_folder import RunFolder

distributed = pytest.importorskip("distributed")
import dask  # noqa: E402
from palpate_kit.jobs import cluster, staging, workers  # noqa: E402
from palpate_kit.jobs.cores import on_all_cores  # noqa: E402
from palpate_kit.jobs.job import Job, Parcel, PortablePipeline  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # of dask's own, when workers die


@pytest.fixture(scope="module")
def store():
    """A server of S3 on this machine, for this process and the workers that it starts; None where there is none."""
    try:
        import s3fs
        from moto.server import ThreadedMotoServer
    except ImportError:
        yield None
        return
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    address, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{address}:{port}")
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            patch.setenv(name, "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        s3fs.S3FileSystem().mkdir("bucket")
        yield address
    server.stop()


@pytest.fixture
def place(store, tmp_path):
    """A place that this machine and all workers reach: in the store, or where there is none in a folder."""
    return f"file://{tmp_path}/place" if store is None else f"s3://bucket/{tmp_path.name}"


@pytest.fixture(scope="module")
def scheduler(store):
    """Two workers on this machine; by address, as any others. They import what this file sends them.

    A task that has killed two of them is given up, so that it kills none that has only just begun: dask starts a worker
    again that dies, but not one that dies before its nanny knows that it has begun.
    """
    with pytest.MonkeyPatch.context() as patch, dask.config.set({"distributed.scheduler.allowed-failures": 1}):
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as running:
            yield running.scheduler_address


def _jobs(pipeline, folder, count):
    text = pipeline.read_text().replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1)
    folder.mkdir(exist_ok=True)
    short = ("trajectory.press.duration=1 s",)
    plans = [PortablePipeline(text, pipeline, (*short, f"run.seed={n}")) for n in range(1, count + 1)]
    return [Job(f"combination {n}", plan, folder / f"{n:05d}") for n, plan in enumerate(plans, start=1)]


def _found(engine, jobs):
    with closing(engine(jobs)) as running:
        return {job.name: json.loads(json.dumps(answer.result.table())) for job, answer in running}


def _numbers(found):
    """What was found, without how long it took."""
    tracks = {(n, name): track for n, result in found.items() for name, track in result["tracks"].items()}
    return {key: {**track, "seconds_per_sample": None} for key, track in tracks.items()}


@pytest.mark.gate
@pytest.mark.slow
def test_results_are_those_of_this_machine_to_the_bit(scheduler, point_pipeline, tmp_path):
    here = _found(lambda jobs: on_all_cores(jobs, 1), _jobs(point_pipeline, tmp_path / "here", 3))
    jobs = _jobs(point_pipeline, tmp_path / "there", 3)
    there = _found(cluster.on_cluster(scheduler, tmp_path / "there"), jobs)
    assert _numbers(there) == _numbers(here)
    assert len(here) == 3
    for number in range(1, 4):
        one, other = (tmp_path / place / f"{number:05d}" / "estimates.csv" for place in ("here", "there"))
        assert one.read_bytes() == other.read_bytes()
    told = json.loads((tmp_path / "there" / "workers.json").read_text())
    assert told["equal"] == "to the bit"
    assert len(told["workers"]) == 2
    assert not [path for path in (tmp_path / "there").iterdir() if path.name.startswith(".")]


@pytest.mark.slow
def test_nothing_is_computed_twice(scheduler, point_pipeline, tmp_path):
    engine = cluster.on_cluster(scheduler, tmp_path / "runs")
    jobs = _jobs(point_pipeline, tmp_path / "runs", 2)
    first = _found(engine, jobs)
    assert _found(engine, jobs) == first  # an answer that was lost is found in the folder
    assert sorted(path.name for path in (tmp_path / "runs").glob("0*")) == ["00001", "00002"]


def _die_when_done(folder):
    """Answer, and have the worker killed before anybody asks for the answer; the second time, wait to be let go on."""
    if (folder / "died").exists():
        while not (folder / "go on").exists():
            time.sleep(0.01)
        return "again"
    (folder / "died").touch()
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return "first"


@pytest.mark.slow
def test_an_answer_that_dies_with_its_worker_is_made_again(scheduler, monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "_LOOK", 1.0)  # it has died when it is looked for
    go_on = threading.Timer(2.5, (tmp_path / "go on").touch)
    go_on.start()
    with distributed.Client(scheduler, set_as_default=False) as client:
        ((_, answer),) = cluster.spread(client, _die_when_done, [tmp_path])
    go_on.join()
    assert answer in ("first", "again")  # the first on a machine so slow that it was fetched before


@pytest.mark.slow
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


def _fits(folder):
    """What `palpate fit` has found in a folder, without how long it took; when each log was fitted."""
    logs = json.loads((folder / "fit.json").read_text())["logs"]
    tracks = {name: {**log["tracks"]["dr/fit"], "seconds_per_sample": None} for name, log in logs.items()}
    return tracks, {name: log["run"]["started"] for name, log in logs.items()}


@pytest.mark.slow
def test_fits_of_several_logs_are_those_of_this_machine(scheduler, place, palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    files = [tmp_path / "one.toml", tmp_path / "two.toml"]
    (tmp_path / "own.py").write_text(OWN)  # both share it, and the workers have never heard of it
    for seed, file in enumerate(files, start=1):
        own = text.replace("seed = 1\n", f'seed = {seed}\nplugins = ["own.py"]\n')
        file.write_text(own + '[estimator.fit]\ntype = "mine"\n')

    def fit(out, *more, code=0):
        done = palpate("fit", *files, "--no-pictures", "--json", "--out", tmp_path / out, *more)
        assert done.returncode == code, done.stderr
        return done, *_fits(tmp_path / out)

    _, here, _ = fit("here")
    first, there, started = fit("there", "--scheduler", scheduler)
    assert list(here) == list(there) == ["one", "two"]
    assert there == here
    # Gone on with: nothing is fitted again but what is not whole, and then beside what is left of it.
    again, found, when = fit("there", "--scheduler", scheduler)
    assert (found, when) == (here, started)
    assert json.loads(again.stdout)["evaluation"] == json.loads(first.stdout)["evaluation"]
    (tmp_path / "there" / "two" / "answer.json").unlink()
    _, found, when = fit("there")
    assert found == here
    assert when["one"] == started["one"]
    assert sorted(path.name for path in (tmp_path / "there").iterdir() if path.is_dir()) == ["one", "two", "two.2"]
    fewer = palpate("fit", files[0], "--out", tmp_path / "there")
    assert fewer.returncode == 2
    assert "holds fits of two, which is not among these; nothing is mixed" in fewer.stderr
    other = palpate("fit", *files, "--out", tmp_path / "there", "--set", "run.seed=7")
    assert other.returncode == 2
    assert (tmp_path / "there" / "one" / "answer.json").is_file()  # what was refused takes nothing away
    # By way of a place: brought here, and found there from elsewhere.
    _, found, started = fit("staged", "--scheduler", scheduler, "--stage", place)
    assert found == here
    assert (tmp_path / "staged" / "two" / "estimates-offline.csv").is_file()
    _, found, when = fit("elsewhere", "--scheduler", scheduler, "--stage", place)
    assert (found, when) == (here, started)
    other, _, _ = fit("elsewhere", "--scheduler", scheduler, "--stage", place, "--set", "run.seed=7", code=2)
    assert "one was run with other settings: run.seed is 7, was 1" in other.stderr


@pytest.mark.slow
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
        with (
            dask.config.set({"distributed.worker.memory.pause": False}),  # only a test pauses
            distributed.LocalCluster(
                n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
            ) as running,
        ):
            yield running


@pytest.mark.slow
def test_where_all_workers_are_gone_it_is_told_and_then_an_end(own_cluster, monkeypatch, capsys):
    for name, seconds in (("_AGAIN", 0.05), ("_REPORT_EVERY", 0.2), ("_WITHOUT", 0.9)):
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


@pytest.mark.slow
def test_workers_that_are_paused_for_their_memory_are_told(own_cluster, monkeypatch, capsys):
    """dask pauses what is near its limit of memory, and keeps its tasks waiting without a word."""
    for name, seconds in (("_AGAIN", 0.05), ("_REPORT_EVERY", 0.2), ("_WITHOUT", 2.0)):
        monkeypatch.setattr(workers, name, seconds)
    with distributed.Client(own_cluster.scheduler_address, set_as_default=False) as client:
        (worker,) = own_cluster.workers.values()
        worker.status = distributed.Status.paused
        with pytest.raises(UserError, match=r"all workers have been paused near the end of their memory for 2 s"):
            list(cluster.spread(client, _slow, [0.0, 0.0]))
        worker.status = distributed.Status.running
        assert len(list(cluster.spread(client, _slow, [0.0, 0.0]))) == 2
    told = capsys.readouterr().err.splitlines()
    assert re.search(r"since \d\d:\d\d:\d\d: restart them, with a larger --memory-limit", told[0])


@pytest.mark.slow
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


@pytest.mark.slow
def test_repeats_are_those_of_this_machine(scheduler, place, palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "6 s"')
    file = tmp_path / "own.toml"
    file.write_text(text.replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1) + "[repeat]\ncount = 2\n")
    command, shared = ("repeat", file, "--track", "dr/ekf"), ("--scheduler", scheduler)
    found = {}
    for way, more in {"here": (), "there": shared, "staged": (*shared, "--stage", f"{place}/repeat")}.items():
        done = palpate(*command, "--json", "--out", tmp_path / f"repeat-{way}", *more)
        assert done.returncode == 0, done.stderr
        found[way] = _plain(json.loads(done.stdout))
    assert all(document == found["here"] for document in found.values())
    for number in ("1", "2"):
        one, other = (tmp_path / f"repeat-{way}" / number for way in ("here", "staged"))
        assert (one / "estimates.csv").read_bytes() == (other / "estimates.csv").read_bytes()
    done = palpate(*command, *shared, "--stage", f"{place}/repeat", "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    one, other = (RunFolder(tmp_path / out / "1").result["run"]["started"] for out in ("repeat-staged", "again"))
    assert one == other


def _plain(document):
    """A document without what is of one run: times, places."""
    if isinstance(document, dict):
        own = ("folder", "seconds_per_sample", "started", "duration", "command", "host", "pipeline", "means")
        return {key: _plain(value) for key, value in document.items() if key not in own}
    return [_plain(value) for value in document] if isinstance(document, list) else document


def test_an_arm_is_not_repeated_on_a_cluster(palpate, point_pipeline, tmp_path):
    text = point_pipeline.read_text().replace('type = "sim"', 'type = "sim"\npace = "real-time"', 1)
    point_pipeline.write_text(text + "[repeat]\ncount = 3\n")
    done = palpate("repeat", point_pipeline, "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "--scheduler is for simulations that keep no clock" in done.stderr
    assert not (tmp_path / "out").exists()


def _csv_pipeline(folder):
    """A pipeline that reads a log of a short press, and both files."""
    run = """
[run]
name = "staged"
[device.log]
type = "csv-replay"
file = "press.csv"
rate = "500 Hz"
columns.z = { column = 0, unit = "m" }
columns.fz = { column = 1, unit = "N" }
[alignment]
force = "log.fz"
position = "log.z"
tare = "none"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5
[estimator.ekf]
type = "ekf"
[sweep]
"estimator.ekf.force_std" = ["0.02 N", "0.05 N"]
"""
    time = np.arange(0.0, 4.0, 0.002)
    height = 0.001 - 0.004 * np.clip(time - 1.0, 0.0, 1.0) + 3e-4 * np.sin(4 * np.pi * time) * (time > 2)
    force = 16 / 9 * 112e3 * np.sqrt(0.005) * np.maximum(-height, 0.0) ** 1.5
    folder.mkdir()
    np.savetxt(folder / "press.csv", np.column_stack([height, force]), delimiter=",", header="z,fz", comments="")
    (folder / "sweep.toml").write_text(run)
    return folder / "sweep.toml"


@pytest.mark.slow
def test_workers_that_share_no_folder_get_inputs_and_give_runs_by_way_of_s3(scheduler, store, palpate, tmp_path):
    if store is None:
        pytest.skip("no S3 server here: pip install 'moto[server]' s3fs")
    file = _csv_pipeline(tmp_path / "own")
    here = palpate("sweep", file, "--jobs", 1, "--json", "--out", tmp_path / "here")
    assert here.returncode == 0, here.stderr
    command = ("sweep", file, "--json", "--scheduler", scheduler, "--stage", "s3://bucket/sweep")
    there = palpate(*command, "--out", tmp_path / "there")
    assert there.returncode == 0, there.stderr
    assert _plain(json.loads(there.stdout))["rows"] == _plain(json.loads(here.stdout))["rows"]
    for number in ("00001", "00002"):
        one, other = (tmp_path / place / number for place in ("here", "there"))
        assert (one / "estimates.csv").read_bytes() == (other / "estimates.csv").read_bytes()
        assert (one / "pipeline.toml").read_bytes() == (other / "pipeline.toml").read_bytes()
    assert not [path for path in (tmp_path / "there").iterdir() if path.name.startswith(".")]
    # Elsewhere they are brought from the store, and other settings are no part of that sweep.
    again = palpate(*command, "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr
    one, other = (RunFolder(tmp_path / place / "00001").result["run"]["started"] for place in ("there", "again"))
    assert one == other
    other = palpate(*command, "--set", "run.seed=7", "--out", tmp_path / "other")
    assert other.returncode == 2
    assert "combination 1 was run with other settings" in other.stderr or "combination 2 was" in other.stderr


class Cable:
    """Between a client and a server: pulled when a word passes, and from then on nobody answers."""

    def __init__(self, port, word):
        self._port, self._word = port, word
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            server = socket.create_connection(("127.0.0.1", self._port))
            for one, other in ((client, server), (server, client)):
                threading.Thread(target=self._carry, args=(one, other), daemon=True).start()

    def _carry(self, one, other):
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                if self._word in data:
                    self._server.shutdown(socket.SHUT_RDWR)
                    self._server.close()
                    break
                other.sendall(data)
        for end in (one, other):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


@pytest.mark.slow
@pytest.mark.parametrize("word", [b"/inputs/", b"runs/00002/log"], ids=["inputs", "run"])
def test_a_store_that_is_lost_ends_a_sweep_that_the_same_words_continue(
    scheduler, store, palpate_process, tmp_path, word
):
    """It is lost to the machine that asks: while inputs are put there, or while a run is brought."""
    if store is None:
        pytest.skip("no S3 server here: pip install 'moto[server]' s3fs")
    file = _csv_pipeline(tmp_path / "own")
    file.write_text(file.read_text() + '[sink.log]\ntype = "mcap"\n')
    place, out = f"s3://bucket/{tmp_path.name}", tmp_path / "out"
    command = ("sweep", file, "--json", "--scheduler", scheduler, "--stage", place, "--out", out)
    cable = Cable(int(os.environ["AWS_ENDPOINT_URL"].rpartition(":")[2]), word)
    lost = palpate_process(*command, AWS_ENDPOINT_URL=cable.url, AWS_MAX_ATTEMPTS="1")
    assert lost.returncode == 2
    assert re.search(rf"--stage {place}: \w+: .*go on with the same --out", lost.stderr), lost.stderr
    assert "Traceback" not in lost.stderr
    assert not (out / "00002").exists()
    done = palpate_process(*command)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["failed"] == 0
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


OWN = """
from palpate import plugin
from palpate_fits import CasadiFit

class Mine(CasadiFit):
    "A fit of one's own."

@plugin
def palpate_estimators():
    return {"mine": Mine}
"""
WORKER = """
import pickle, sys
from palpate_kit.jobs.staging import run_staged
staged = pickle.load(sys.stdin.buffer)
answer = run_staged(staged)
with staged.parcel.unpacked() as job:
    assert type(job.plan.estimators["fit"]).__name__ == "Mine"
print(answer.result.tracks["dr/fit"].parameters["elasticity"].value)
"""


@pytest.mark.slow
def test_a_plugin_file_goes_along_with_what_its_parts_are_in(point_pipeline, tmp_path):
    """In a process that has never heard of it, on a machine that does not have it."""
    own = tmp_path / "own.py"
    own.write_text(OWN)
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    text = text.replace("[run]\n", '[run]\nplugins = ["own.py"]\ntracks = ["dr/fit"]\n', 1)
    point_pipeline.write_text(text + '[estimator.fit]\ntype = "mine"\n')
    jobs = [Job(f"own {n}", load_pipeline(point_pipeline), tmp_path / f"own {n}") for n in range(2)]
    stage = staging.Stage(f"file://{tmp_path}/stage")
    inputs = stage.put_inputs(job.pipeline() for job in jobs)
    staged, other = (staging.StagedJob(Parcel.of(job), stage, inputs) for job in jobs)
    with other.parcel.unpacked() as job:
        assert type(job.plan.estimators["fit"]) is type(jobs[0].plan.estimators["fit"])
    own.unlink()
    done = subprocess.run([sys.executable, "-c", WORKER], input=pickle.dumps(staged), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert float(done.stdout) == pytest.approx(112.5e3, rel=0.05)
    own.write_text(OWN + "# changed\n")
    load_pipeline(point_pipeline)  # its classes are not those of the first time any more
    with pytest.raises(ConfigurationError, match=r"own 0: cannot be sent to another process: .*install what is in a"):
        Parcel.of(jobs[0])


@pytest.mark.slow
def test_an_input_is_put_where_it_belongs_and_nothing_is_written_over(tmp_path):
    stage = staging.Stage(f"file://{tmp_path}/stage")
    file = _csv_pipeline(tmp_path / "own")
    job = Job("one", PortablePipeline(file.read_text(), file), tmp_path / "one")
    inputs = stage.put_inputs([job.pipeline()])
    staged = staging.StagedJob(Parcel.of(job), stage, inputs)
    log = tmp_path / "own" / "press.csv"
    assert list(inputs) == [str(log)]
    content = log.read_bytes()
    log.unlink()
    stage.get_inputs(inputs)
    assert log.read_bytes() == content
    log.write_text("something else")
    assert "this worker has another file of that name" in str(staging.run_staged(staged))
    assert log.read_text() == "something else"
    log.unlink()
    (stored,) = (tmp_path / "stage" / "inputs").iterdir()
    stored.write_bytes(content[:100])
    assert "press.csv is not whole there" in str(staging.run_staged(staged))
    assert [path.name for path in log.parent.iterdir()] == ["sweep.toml"]
    nowhere = replace(staged, stage=staging.Stage("http://127.0.0.1:9/stage"))
    assert re.match(r"--stage http://127\.0\.0\.1:9/stage: \w+: ", str(staging.run_staged(nowhere)))


def test_a_stage_without_a_scheduler_or_of_no_kind_is_a_mistake(palpate, point_pipeline, tmp_path):
    point_pipeline.write_text(point_pipeline.read_text() + '[sweep]\n"run.seed" = [1, 2]\n')
    done = palpate("sweep", point_pipeline, "--stage", "s3://bucket/x", "--out", tmp_path / "a")
    assert done.returncode == 2
    assert "give --scheduler" in done.stderr
    with pytest.raises(ConfigurationError, match="--stage nowhere://x: Protocol not known"):
        staging.Stage("nowhere://x").put_inputs([])


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


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(scheduler, tmp_path):  # the last of this file: it leaves a worker less
    with distributed.Client(scheduler, set_as_default=False) as client:
        tasks = [(tmp_path, number) for number in range(8)]
        found = [outcome for _, outcome in cluster.spread(client, _die_once, tasks)]
        assert sorted(found) == list(range(8))
        assert all((tmp_path / str(n)).read_text() == "done\n" for n in range(8))
        ((_, outcome),) = cluster.spread(client, _die, ["x"])
    assert "killed several times" in cluster.loss_reason(outcome)
