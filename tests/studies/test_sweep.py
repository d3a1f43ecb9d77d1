"""``palpate sweep`` and ``palpate info``."""

import csv
import json
import os
import shutil
import signal
import time

import pytest

from tests.processes import PALPATE, PIPE, start

SWEEP = """
[sweep]
"run.seed" = [1, 2]
estimator.ekf.force_std = ["0.05 N", "-1 N"]
"""


def with_sweep(pipeline, table):
    text = pipeline.read_text().replace('duration = "10 s"', 'duration = "6 s"')
    text = text.replace("seed = 1\n", 'seed = 1\ntracks = ["dr/ekf"]\n', 1)
    pipeline.write_text(text + table)
    return pipeline


def rows(folder):
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.gate
@pytest.mark.slow
def test_every_combination_gets_a_row_and_a_failure_its_reason(palpate, point_pipeline, tmp_path):
    file, out = with_sweep(point_pipeline, SWEEP), tmp_path / "out"
    done = palpate("sweep", file, "--out", out)
    assert done.returncode == 1, done.stderr
    assert "4 combinations, 2 failed" in done.stdout
    found = rows(out)
    assert [(row["run.seed"], row["estimator.ekf.force_std"]) for row in found] == [
        ("1", "0.05 N"),
        ("1", "-1 N"),
        ("2", "0.05 N"),
        ("2", "-1 N"),
    ]
    good = [row for row in found if not row["error"]]
    assert len({row["elasticity [Pa]"] for row in good}) == 2
    assert all(float(row["elasticity_std"]) > 0 for row in good)
    assert all("must be greater than 0" in row["error"] for row in found if row not in good)
    table = json.loads((out / "sweep.json").read_text())
    assert table[0]["elasticity [Pa]"] == float(found[0]["elasticity [Pa]"])
    assert not (out / "sweep.csv.part").exists()

    # What is there is not run again; what is missing is, to the same bits.
    before = (out / "sweep.csv").read_text()
    stamps = {path: path.stat().st_mtime_ns for path in out.glob("*/result.json")}
    shutil.rmtree(out / "00003")
    done = palpate("sweep", file, "--out", out)
    assert "1 found in the folder" in done.stdout
    assert (out / "sweep.csv").read_text() == before
    assert (out / "00001" / "result.json").stat().st_mtime_ns == stamps[out / "00001" / "result.json"]


@pytest.mark.slow
def test_a_list_pairs_its_values(palpate, point_pipeline, tmp_path):
    table = '[sweep]\ncombine = "list"\n"run.seed" = [1, 2]\n"estimator.ekf.force_std" = [0.04, 0.06]\n'
    out = tmp_path / "out"
    done = palpate("sweep", with_sweep(point_pipeline, table), "--out", out, "--jobs", 1)
    assert done.returncode == 0, done.stderr
    assert [(row["run.seed"], row["estimator.ekf.force_std"]) for row in rows(out)] == [("1", "0.04"), ("2", "0.06")]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", "the table [sweep] is missing"),
        ("[sweep]\n", "names no setting"),
        ('[sweep]\n"run.seed" = 3\n', "[sweep] run.seed: 3: must be a list of values"),
        ("[sweep]\nseed = [3]\n", "[sweep] seed: must be a setting with its table"),
        ('[sweep]\ncombine = "all"\n"run.seed" = [3]\n', '\'all\' is not one of "grid", "list"'),
        ('[sweep]\ncombine = "list"\n"run.seed" = [3]\n"run.average" = [1, 2]\n', "run.seed has 1, run.average has 2"),
        ('[sweep]\n"estimator.ekf.forcestd" = [1]\n', "unknown key 'forcestd'"),
    ],
)
def test_a_mistake_is_told_before_anything_runs(palpate, point_pipeline, tmp_path, table, words):
    done = palpate("sweep", with_sweep(point_pipeline, table), "--out", tmp_path / "out")
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_folder_holds_one_sweep(palpate, point_pipeline, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "sweep.toml").write_text("another")
    done = palpate("sweep", with_sweep(point_pipeline, SWEEP), "--out", out)
    assert done.returncode == 2
    assert "holds the sweep of another pipeline file" in done.stderr


def test_a_sweep_table_does_not_disturb_a_run(palpate, point_pipeline):
    assert palpate("check", with_sweep(point_pipeline, SWEEP)).returncode == 0


def test_info_says_which_kernel_runs_and_why(palpate):
    assert (
        "kernel: CasADi virtual machine (PALPATE_KERNEL=vm asks for it)" in palpate("info", PALPATE_KERNEL="vm").stdout
    )
    done = palpate("info", PALPATE_KERNEL="quick")
    assert done.returncode == 2
    assert "'quick' is not one of" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_ends_a_sweep_and_leaves_no_half_result(palpate, point_pipeline, tmp_path, jobs):
    file, out = with_sweep(point_pipeline, '[sweep]\n"run.seed" = [1, 2, 3]\n'), tmp_path / "out"
    words = ["--jobs", jobs, "--set", "device.rig.pace=real-time"]
    process = start(PALPATE, "sweep", file, "--out", out, *words, stdout=PIPE, stderr=PIPE, text=True, session=True)
    deadline = time.monotonic() + 120
    while not any(log.stat().st_size > 100_000 for log in out.glob("0000*/log.mcap")):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    assert not (out / "sweep.csv").exists() or rows(out) == []
    again = palpate("sweep", file, "--out", out)
    assert "3 combinations, 0 failed" in again.stdout
    assert all("interrupted" not in row["flags"] for row in rows(out))
