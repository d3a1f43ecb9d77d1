"""Nothing mixed, nothing half, nothing lost: sweeps with other settings, damaged results, batches, killed workers."""

import json
import shutil

import pytest
from palpate import LogError, OutputError
from palpate_engine import resolved_text, trust_plugin, whole_file
from palpate_engine.config import load_pipeline
from palpate_kit.jobs.cores import on_all_cores
from palpate_kit.jobs.job import Job, PortablePipeline, cached_result
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.runs.run_folder import RunFolder
from palpate_maps.commands.lumps_command import by_place
from palpate_maps.path_reader import demand_one_pipeline

SWEEP = '[sweep]\n"run.seed" = [1, 2]\n'
SHORT = ("--set", "trajectory.press.duration=1 s")
KINEMATIC = ("trajectory.press.duration=1 s", 'run.tracks=["dr/kinematic"]')  # which determines E in a second


@pytest.fixture
def sweep_file(point_pipeline):
    """The example with two seeds."""
    text = point_pipeline.read_text().replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1)
    point_pipeline.write_text(text + SWEEP)
    return point_pipeline


@pytest.mark.slow
def test_a_sweep_is_not_gone_on_with_by_other_settings_and_half_a_result_is_none(palpate, sweep_file, tmp_path):
    out = tmp_path / "out"
    assert palpate("sweep", sweep_file, "--out", out, "--jobs", 1, *SHORT).returncode == 0
    before = (out / "sweep.csv").read_bytes()
    done = palpate("sweep", sweep_file, "--out", out, "--jobs", 1, *SHORT, "--set", "estimator.ekf.force_std=0.2 N")
    assert done.returncode == 2
    assert "combination 1 was run with other settings: estimator.ekf.force_std is 0.2, was 0.05" in done.stderr
    assert (out / "sweep.csv").read_bytes() == before
    result = out / "00002" / "result.json"
    result.write_bytes(result.read_bytes()[:300])
    done = palpate("sweep", sweep_file, "--out", out, "--jobs", 1, *SHORT)
    assert done.returncode == 0, done.stderr
    assert "1 found in the folder" in done.stdout
    assert (out / "sweep.csv").read_bytes() == before


@pytest.mark.slow
def test_what_is_refused_leaves_no_folder(palpate, sweep_file, tmp_path):
    for command in ("run", "sweep"):
        done = palpate(command, sweep_file, "--set", "estimator.ekf.force_std=-1 N")
        assert done.returncode == 2
    done = palpate("run", sweep_file, "--set", 'device.rig={type="mcap-replay", file="none.mcap"}', "--out", "out")
    assert done.returncode == 2
    log = tmp_path / "cut.mcap"
    log.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    done = palpate("run", sweep_file, "--set", f'device.rig={{type="mcap-replay", file="{log}"}}', "--out", "out")
    assert done.returncode == 2
    assert not (tmp_path / "runs").exists()
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("table", ["sweep", "repeat"])
def test_one_run_of_a_file_that_asks_for_many_says_so(palpate, sweep_file, table, tmp_path):
    more = ("--set", "repeat.count=3") if table == "repeat" else ()
    done = palpate("run", sweep_file, *SHORT, *more, "--json", "--out", "one")
    assert done.returncode == 0, done.stderr
    assert f"one run: [{table}] is for `palpate {table} {sweep_file}`" in done.stderr
    assert (tmp_path / "one" / "result.json").is_file()


@pytest.mark.slow
def test_a_part_of_other_settings_is_no_part(point_pipeline, tmp_path):
    first, other = (load_pipeline(point_pipeline, [f"estimator.ekf.force_std={std}"]) for std in (0.05, 0.06))
    for folder, pipeline in ((tmp_path / "run", first), (tmp_path / "run" / "part-2", other)):
        folder.mkdir()
        (folder / "resolved.toml").write_text(resolved_text(pipeline))
    with pytest.raises(LogError, match=r"nothing is mixed: estimator.ekf.force_std is 0.06, was 0.05"):
        demand_one_pipeline(RunFolder(tmp_path / "run"))
    (tmp_path / "run" / "part-2" / "resolved.toml").write_text(resolved_text(first).replace("seed = 1", "seed = 9"))
    demand_one_pipeline(RunFolder(tmp_path / "run"))


def test_differences_are_named_by_their_keys():
    assert differences("a = 1\n[b]\nc = 2", "a = 1\n[b]\nc = 2") == ""
    assert differences("[b]\nc = 2\nd = 1", "[b]\nc = 3\nd = 4", ("b.d",)) == "b.c is 2, was 3"
    assert differences("[b]\nc = 2", "") == "b.c is 2, was not given"


def test_a_file_is_whole_or_as_it_was(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old")

    def fill():
        with whole_file(path) as file:
            file.write("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left"):
        fill()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.json"]
    with whole_file(path) as file:
        file.write("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


@pytest.mark.slow
def test_a_batch_goes_on_after_a_bad_one(palpate, point_pipeline, run_point, tmp_path):
    good = [run_point(*KINEMATIC, f"run.seed={seed}", name=f"run{seed}") for seed in (1, 2)]
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "result.json").write_text('{"half": ')
    done = palpate("repeat", *(run.folder for run in good), tmp_path / "bad", "--track", "dr/kinematic", "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout)["groups"]["runs"]["count"] == 2
    assert "bad is left out" in done.stderr
    assert "is not a result of palpate" in done.stderr
    shutil.copy(good[0].folder / "log.mcap", tmp_path / "good.mcap")
    (tmp_path / "bad.mcap").write_bytes((tmp_path / "good.mcap").read_bytes()[:5000])
    done = palpate("fit", "bad.mcap", "good.mcap", "--no-pictures", "--out", "fits")
    assert done.returncode == 1, done.stderr
    assert "bad.mcap is left out" in done.stderr or "bad is left out" in done.stderr
    assert list(json.loads((tmp_path / "fits" / "fit.json").read_text())["logs"]) == ["good"]
    assert palpate("fit", "bad.mcap", "--no-pictures", "--out", "none").returncode == 2
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_sites_are_counted_by_place_and_points_without_one_are_sites(palpate, run_point, tmp_path):
    runs = [run_point(*KINEMATIC, f"run.seed={n}", name=f"r{n}").folder for n in (1, 2)]
    more = []
    for number in range(3):
        shutil.copytree(runs[0], tmp_path / f"copy{number}")
        more.append(tmp_path / f"copy{number}")
    baseline = [part for run in (runs[0], *more) for part in ("--baseline", run)]
    done = palpate("map", "compare", *baseline, "--suspect", runs[1], "--track", "dr/kinematic")
    assert done.returncode == 0, done.stderr
    assert "4 baseline" in done.stdout
    done = palpate("map", "compare", *baseline, "--suspect", runs[0], "--track", "dr/kinematic")
    assert done.returncode == 2
    assert "is also a --baseline" in done.stderr
    done = palpate("map", "compare", *baseline, "--baseline", runs[0], "--suspect", runs[1], "--track", "dr/kinematic")
    assert done.returncode == 2
    assert "given twice" in done.stderr
    near = [((0.0, 0.0), 1.0), ((1e-4, 0.0), 4.0), ((0.01, 0.0), 3.0)]
    assert by_place(near).tolist() == [pytest.approx(2.0), pytest.approx(3.0)]


KILLER = "import os, pathlib, signal\n{guard}os.kill(os.getpid(), signal.SIGKILL)\n"


@pytest.mark.slow
def test_a_killed_worker_loses_no_job_and_the_one_that_kills_three_is_named(tmp_path):
    once = "if not pathlib.Path('killed').exists():\n    pathlib.Path('killed').touch()\n    "
    (tmp_path / "once.py").write_text(KILLER.format(guard=once).replace("'killed'", repr(str(tmp_path / "killed"))))
    (tmp_path / "always.py").write_text(KILLER.format(guard=""))
    for name in ("once.py", "always.py"):
        trust_plugin(tmp_path / name)
    texts = ["[run]\n"] * 3 + ['[run]\nplugins = ["once.py"]\n', '[run]\nplugins = ["always.py"]\n'] + ["[run]\n"] * 3
    plans = [PortablePipeline(text, tmp_path / "p.toml") for text in texts]
    jobs = [Job(f"job {n}", plan, tmp_path / str(n)) for n, plan in enumerate(plans, 1)]
    found = {job.name: str(error) for job, error in on_all_cores(jobs, 2)}
    assert sorted(found) == [f"job {n}" for n in range(1, 9)]
    assert "its process was killed 3 times" in found.pop("job 5")
    assert all("[alignment] is missing" in error for error in found.values())
    assert all(cached_result(job) is None for job in jobs)
