"""Python files of the current folder are executed by no process of palpate, whatever their names."""

import ast
import asyncio
import itertools
import os
import shutil
import sys
from concurrent.futures import wait
from pathlib import Path

import pytest
from palpate import ConfigurationError
from palpate_desk.curve_answers import curve_answer
from palpate_desk.desk import Desk
from palpate_desk.folder_view import exported
from palpate_desk.page_messages import read_message
from palpate_desk.refits import Worker
from palpate_engine import safe_processes
from palpate_engine.cli import main
from palpate_kit.acquisition.computer import Computer
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.jobs.process_pool import process_pool

from tests.curves.conftest import NAMES, fits_once, folder  # noqa: F401

_NAMES = ("signal", "numpy", "serial", "struct", "rtde_receive", "palpate", "palpate_kit", "casadi")


@pytest.fixture
def traps(tmp_path, monkeypatch):
    """The current folder, with files that leave a trace when they are executed; at the end there is none."""
    for name in _NAMES:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / f'{name}.trace')!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not sorted(file.name for file in tmp_path.glob("*.trace"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "module", ["palpate_arms.arm_worker", "palpate_kit.acquisition.sensor_worker", "palpate_ros2.worker"]
)
def test_a_device_process(traps, module):
    reading, writing = os.pipe()
    os.close(writing)
    process = Computer().start("sensor", module, [reading, reading], "{}")
    process.wait(60)
    os.close(reading)


@pytest.mark.slow
def test_a_robot_and_its_sensor(traps, palpate, root):
    """Nothing answers: their processes say so, and not what a file of the folder does to them."""
    shutil.copy(root / "pipelines" / "point_ur3e.toml", traps)
    here = ["--set", "device.arm.host=127.0.0.99", "--set", "device.sensor.port=/nowhere"]
    done = palpate("doctor", "point_ur3e.toml", *here)
    assert done.returncode, done.stdout


@pytest.mark.slow
def test_the_pools_of_fit(folder, traps, palpate):  # noqa: F811
    """Also that of a folder of fits."""
    done = palpate("fit", "curves", "--tip", "paraboloid 3 mm", "--out", "more", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    done = palpate("fit", "more", "--set", "estimator.fit.segment=load", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    assert {row.state for row in FitFolder(Path("more")).rows} == {"current"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("sweep", '[sweep]\n"run.seed" = [1, 2]\n', "--jobs", "2"),
        ("repeat", "[repeat]\ncount = 2\n"),
    ],
)
def test_the_pools_of_many_runs(traps, palpate, point_pipeline, command):
    name, table, *options = command
    with point_pipeline.open("a", encoding="utf-8") as file:
        file.write(table)
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["dr/kinematic"]']
    done = palpate(name, point_pipeline, *short, *options, "--out", "out")
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_processes_of_the_desk(folder, traps):  # noqa: F811
    desk, worker = Desk(folder / "fits"), Worker()
    try:
        answer = asyncio.run(worker.call(curve_answer, desk.reader(NAMES[0]), desk.curve(NAMES[0]), True))
    finally:
        worker.close()
    assert answer.error == ""
    question = read_message('{"do": "groups", "by": "sample", "parameter": "elasticity"}')
    with pytest.raises(ConfigurationError, match="sample"):
        asyncio.run(exported(desk, question))


@pytest.mark.slow
def test_a_pool_of_a_program_in_python(traps):
    """The environment of that program stays as it was, for its own processes."""
    before, path = dict(os.environ), sys.path[:]
    with process_pool(2) as pool:
        done, _ = wait([pool.submit(os.getpid), pool.submit(os.getpid)])
        assert all(future.result() != os.getpid() for future in done)
    assert (dict(os.environ), sys.path) == (before, path)


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "threads"), [(None, "1"), ("3", "3")])
def test_a_process_of_a_pool_has_one_thread_of_linear_algebra(monkeypatch, stated, threads):
    """Also where a program in Python starts it, whose own environment stays as it was."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if stated:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", stated)
    with process_pool(1) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == threads
    assert os.environ.get("OPENBLAS_NUM_THREADS") == stated


@pytest.mark.parametrize("before", [None, "1"])
def test_the_environment_is_put_back(monkeypatch, before):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    if before:
        monkeypatch.setenv("PYTHONSAFEPATH", before)
    with safe_processes():
        assert os.environ["PYTHONSAFEPATH"]
    assert os.environ.get("PYTHONSAFEPATH") == before


def test_a_command_looks_for_modules_in_no_current_folder(monkeypatch, capsys):
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    seen = []
    monkeypatch.setattr(
        "palpate_engine.cli.command_line._main", lambda given: seen.append((sys.path[:], os.environ["PYTHONSAFEPATH"]))
    )
    main(["--version"])
    ((path, safe),) = seen
    assert safe
    assert "" not in path
    assert sys.path[0] == ""


def test_every_program_in_python_is_started_without_the_current_folder(root):
    """`-P` stands behind every `sys.executable`, and one function makes all pools."""
    for file in [*root.glob("core/**/*.py"), *root.glob("plugins/**/*.py")]:
        text = file.read_text()
        if "sys.executable" not in text and "ProcessPoolExecutor(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "ProcessPoolExecutor":
                assert file.name in ("process_pool.py", "monte_carlo.py"), file  # the latter forks
            words = node.elts if isinstance(node, ast.List) else node.args if isinstance(node, ast.Call) else []
            for word, after in itertools.pairwise(words):
                if ast.unparse(word) == "sys.executable":
                    assert ast.unparse(after) == "'-P'", file
