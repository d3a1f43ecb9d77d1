"""A log that another program truncates while it is written, and a run that can open no more files."""

import contextlib
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from palpate import OutputError
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.pipeline.closing_reserve import closing_reserve

from tests.simulated import pipeline, solid

ROOT = Path(__file__).parents[2]
MOTION = 'type = "point"\nbias = "3 mm"\namplitude = "1 mm"\nfrequency = "2 Hz"\nduration = "8 s"\nstandstill = "0.3 s"'


def recorded(tmp_path, happen, reached=2.0):
    """Run with a log, and let something happen once so much of the record [s] is there."""
    text = pipeline(solid("80 kPa", "60 kPa", "1 s"), MOTION, 'type = "casadi-fit"\nprofile = false')
    (tmp_path / "press.toml").write_text(f'{text}\n[sink.log]\ntype = "mcap"\n')
    times = []

    def progress(time, total, behind):
        if time > reached and not times:
            times.append(time)
            happen(tmp_path / "out" / "log.mcap")

    return run_pipeline(load_pipeline(tmp_path / "press.toml"), tmp_path / "out", progress)


@pytest.mark.parametrize("size", [0, 500])
def test_a_log_that_another_program_truncates_is_a_finding(tmp_path, size):
    """What is left of it is not touched, and the result says so."""
    kept = []

    def cut(log):
        os.truncate(log, size)
        kept.append(log.read_bytes())

    with pytest.raises(OutputError, match=r"another program has truncated it: .* bytes are left of what was recorded"):
        recorded(tmp_path, cut)
    assert (tmp_path / "out" / "log.mcap").read_bytes() == kept[0]
    (track,) = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"].values()
    told = {flag["code"]: flag["message"] for flag in track["flags"]}
    assert "another program has truncated it" in told["interrupted"]


LEAKING = """
import os, resource, sys, threading, time
from pathlib import Path
from palpate_engine.pipeline import run_pipeline
from tests.devices.simulated_bench import SHORT, SimulatedBench

begun, over, held = threading.Event(), threading.Event(), []

def leak():
    begun.wait()
    while not over.is_set():
        try:
            while True:
                held.append(os.open("/dev/null", os.O_RDONLY))
        except OSError:
            time.sleep(0.001)

folder = Path(sys.argv[1])
rig = SimulatedBench(folder, SHORT)
resource.setrlimit(resource.RLIMIT_NOFILE, (80, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
threading.Thread(target=leak, daemon=True).start()
try:
    run_pipeline(rig.pipeline(), folder / "out", lambda reached, total, behind: begun.set() if reached > 3.0 else None)
finally:
    over.set()
"""


@pytest.mark.slow
def test_a_result_is_written_without_descriptors(tmp_path):
    """A program part that leaks open files takes each one that is closed, to the end of the process."""
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed")
    done = subprocess.run([sys.executable, "-c", LEAKING, tmp_path], capture_output=True, text=True, cwd=ROOT)
    table = json.loads((tmp_path / "out" / "result.json").read_text())
    assert table["tracks"]["dr/ekf"]["parameters"]["elasticity"]["value"] > 50e3, done.stderr
    assert not list((tmp_path / "out").glob(".*"))


def test_the_file_that_is_kept_open_becomes_the_result(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    held = []
    with closing_reserve(tmp_path, True) as room:
        assert not list(tmp_path.iterdir())
        room.release()
        resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 8, hard))
        try:
            with contextlib.suppress(OSError):
                while True:
                    held.append(os.open(os.devnull, os.O_RDONLY))
            with pytest.raises(OSError, match="Too many open files"):
                os.open(os.devnull, os.O_RDONLY)
            is_written = room.write(tmp_path / "result.json", "{}\n")
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for descriptor in held:
                os.close(descriptor)
    assert is_written
    assert (tmp_path / "result.json").read_text() == "{}\n"


def test_without_a_reserve_nothing_is_written(tmp_path):
    with closing_reserve(tmp_path, False) as room:
        room.release()
        assert not room.write(tmp_path / "result.json", "{}\n")
    assert not list(tmp_path.iterdir())
