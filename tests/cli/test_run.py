"""`palpate run`: what a new user sees and gets."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from tests.processes import DEVNULL, PALPATE, PIPE, run, start

SHORT = ("--set", "trajectory.press.duration=2 s")


@pytest.mark.slow
def test_the_example_prints_the_truth_beside_the_estimates(palpate, point_pipeline, tmp_path):
    done = palpate("run", point_pipeline, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for text in ("dr/ekf", "kPa  verdict", "Pa s  verdict", "truth", "112.5", "362", "±", "NIS", "help:"):
        assert text in done.stdout
    for text in ("eta/G", "surface", "assumed exact"):
        assert text not in done.stdout.partition("doubtful[")[0]
    assert max(map(len, done.stdout.partition("written to")[0].splitlines())) <= 80
    assert f"written to {tmp_path / 'out'}" in done.stdout.replace("\n", " ")


@pytest.mark.slow
def test_details_are_everything(palpate, point_pipeline, tmp_path):
    done = palpate("run", point_pipeline, *SHORT, "--details", "--out", tmp_path / "out")
    for text in ("eta/G", "surface", "NIS", "assumed exact", "not-converged: only 1.5 s were tracked"):
        assert text in " ".join(done.stdout.split())


@pytest.mark.slow
def test_the_run_folder(palpate, point_pipeline, tmp_path):
    assert palpate("run", point_pipeline, *SHORT, "--seed", 7).returncode == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("_S2-simulated")
    names = {path.name for path in folder.iterdir()}
    assert names == {"pipeline.toml", "given.toml", "result.json", "estimates.csv", "log.mcap"}
    assert (folder / "given.toml").read_text() == point_pipeline.read_text()
    result = json.loads((folder / "result.json").read_text())
    run = result["run"]
    assert run["seed"] == 7
    assert {"name", "started", "duration", "host", "versions", "plugins", "command", "log_duration", "inputs"} <= set(
        run
    )
    assert set(result["streams"]) == {"rig.wrench", "rig.tip", "rig.twist", "rig.setpoint"}
    assert {"samples", "rate", "invalid", "gaps"} <= set(result["streams"]["rig.wrench"])
    track = result["tracks"]["dr/ekf"]
    assert set(track) >= {
        "model", "estimator", "samples", "parameters", "surface", "force_rms", "nis", "flags", "seconds_per_sample",
    }  # fmt: skip
    assert set(track["parameters"]) == {"elasticity", "viscosity"}
    assert track["parameters"]["elasticity"]["unit"] == "Pa"
    assert track["parameters"]["viscosity"]["unit"] == "Pa*s"
    for found in (*track["parameters"].values(), track["surface"]):
        assert {"value", "std", "unit"} <= set(found)
    with (folder / "estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {"time_s", "dr/ekf:elasticity", "dr/ekf:elasticity_std", "dr/ekf:viscosity"} <= set(rows[0])
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    assert times[1] - times[0] == pytest.approx(0.01)


@pytest.mark.slow
def test_a_second_run_in_the_same_second_gets_its_own_folder(palpate, point_pipeline, tmp_path):
    for _ in range(2):
        assert palpate("run", point_pipeline, *SHORT).returncode == 0
    assert len(list((tmp_path / "runs").iterdir())) == 2


@pytest.mark.gate
@pytest.mark.slow
def test_the_same_input_gives_the_same_result_bit_for_bit(palpate, palpate_process, point_pipeline, tmp_path):
    for name, call in (("one", palpate), ("two", palpate_process)):
        assert call("run", point_pipeline, *SHORT, "--out", tmp_path / name).returncode == 0
    for file in ("estimates.csv", "pipeline.toml"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    other = palpate("run", point_pipeline, *SHORT, "--seed", 99, "--out", tmp_path / "three")
    assert other.returncode == 0
    assert (tmp_path / "one" / "estimates.csv").read_bytes() != (tmp_path / "three" / "estimates.csv").read_bytes()


@pytest.mark.slow
def test_json_is_the_only_thing_on_standard_output(palpate, point_pipeline, tmp_path):
    done = palpate("run", point_pipeline, *SHORT, "--json", "--out", tmp_path / "out")
    assert json.loads(done.stdout) == json.loads((tmp_path / "out" / "result.json").read_text())


def test_settings_from_the_command_line(palpate, point_pipeline, tmp_path):
    done = palpate(
        "run", point_pipeline, *SHORT, "--set", "estimator.ekf.force_std=0.1 N", "--json", "--out", tmp_path / "out"
    )
    assert "force_std = 0.1" in (tmp_path / "out" / "pipeline.toml").read_text()
    assert done.returncode == 0


def wait_until(condition):
    """Wait for what must come."""
    deadline = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < deadline, "it never came"
        time.sleep(0.02)


@pytest.mark.gate
@pytest.mark.parametrize(
    "number", [signal.SIGINT, *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGTERM, signal.SIGHUP))]
)
def test_ctrl_c_ends_cleanly_with_what_was_found_so_far(point_pipeline, tmp_path, number):
    words = ["--set", "device.rig.pace=real-time", "--out", tmp_path / "out"]
    process = start(PALPATE, "run", point_pipeline, *words, cwd=tmp_path, stdout=PIPE, stderr=PIPE, text=True)
    log = tmp_path / "out" / "log.mcap"
    wait_until(lambda: log.exists() and log.stat().st_size > 300_000)
    process.send_signal(number)
    out, errors = process.communicate(timeout=120)
    assert process.returncode == 128 + number, errors
    # After SIGHUP there is no terminal to print a table on.
    assert ("stopped by" in " ".join(out.split())) == (number != signal.SIGHUP)
    assert f"partial, in {tmp_path / 'out'}" in errors.replace("\n", " ")
    assert "Traceback" not in errors
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert 1.0 < result["run"]["log_duration"] < 12.0
    from palpate_devices.mcap_replay import McapReplay

    with McapReplay(file=log).connect(0) as link:
        last = max(int(batch.time[-1]) for batch in link.batches() if batch.stream == "tip")
        first = 0
    from mcap.reader import make_reader

    with log.open("rb") as file:
        statistics = make_reader(file).get_summary().statistics
    assert (last - statistics.message_start_time) / 1e9 > result["run"]["log_duration"] - 0.1
    assert first == 0


@pytest.mark.slow
def test_a_killed_run_leaves_a_log_that_opens(point_pipeline, tmp_path):
    words = ["--set", "device.rig.pace=real-time", "--out", tmp_path / "out"]
    process = start(PALPATE, "run", point_pipeline, *words, cwd=tmp_path, stdout=DEVNULL, stderr=DEVNULL)
    log = tmp_path / "out" / "log.mcap"
    wait_until(lambda: log.exists() and log.stat().st_size > 300_000)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    from palpate_devices.mcap_replay import McapReplay

    with McapReplay(file=log, accept_cut=True).connect(0) as link:
        stamps = [int(stamp) for batch in link.batches() if batch.stream == "tip" for stamp in batch.time]
    assert stamps[-1] - stamps[0] > 0.5e9  # what a kill costs, `benchmarks/kill.py` measures


@pytest.mark.slow
@pytest.mark.parametrize("flushes", ["in time", "none in time"])
def test_a_full_disk_ends_the_run_with_one_message_and_a_log_that_opens(flushes, point_pipeline, tmp_path):
    """A limit on the size of files stands for the disk: the write fails in the same place."""
    script = (
        "import resource\n"
        "from palpate_devices import log_recorder\n"
        f"log_recorder.FLUSH_EVERY = {0.15 if flushes == 'in time' else 60.0}\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))\n"
        "from palpate_engine.cli import main\nmain()\n"
    )
    done = run(script, "run", point_pipeline, "--out", tmp_path / "out", cwd=tmp_path, timeout=60)
    assert done.returncode == 2
    assert "sink mcap: cannot write" in done.stderr
    assert "Traceback" not in done.stderr
    from palpate_devices.mcap_replay import McapReplay

    with McapReplay(file=tmp_path / "out" / "log.mcap").connect(0) as link:  # a log that is cut is refused
        assert sum(len(batch.time) for batch in link.batches()) > 1000
    flags = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]["dr/ekf"]["flags"]
    assert any(flag["code"] == "interrupted" and "cannot write" in flag["message"] for flag in flags)


def test_a_sink_stays_in_the_run_folder(palpate, point_pipeline):
    done = palpate("check", point_pipeline, "--set", "sink.log.file=../log.mcap")
    assert done.returncode == 2
    assert "[sink.log] file: '../log.mcap'" in done.stderr


@pytest.mark.slow
def test_a_terminal_that_goes_ends_nothing_under_nohup(point_pipeline, tmp_path):
    command = [sys.executable, "-c", "from palpate_engine.cli import main; main()", "run", str(point_pipeline), *SHORT]
    command += ["--set", "device.rig.pace=real-time", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(["nohup", *command], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_until((tmp_path / "out" / "estimates.csv").exists)
    process.send_signal(signal.SIGHUP)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    flags = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"]["dr/ekf"]["flags"]
    assert "interrupted" not in [flag["code"] for flag in flags]
