"""Commands of the tests are what they would be at a terminal, and leave nothing behind."""

import logging
import os
import signal
import subprocess
import sys
import warnings
from contextlib import contextmanager

import pytest

from tests.processes import DEVNULL, PALPATE, PIPE, run, start


@contextmanager
def ignored(*numbers):
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_process_hears_signals_that_pytest_ignores(number):
    words = "import signal, time\nprint('there', flush=True)\ntime.sleep(60)\n"
    with ignored(signal.SIGINT, signal.SIGHUP):
        process = start(words, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, text=True)
    assert process.stdout.readline() == "there\n"
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == -number
    assert ("KeyboardInterrupt" in errors) == (number == signal.SIGINT)


def test_a_process_that_takes_too_long_is_killed():
    with pytest.raises(subprocess.TimeoutExpired):
        run("import time; time.sleep(60)", timeout=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("describe", "flat"), ("no-such-command",)], ids=lambda words: words[0])
def test_a_call_says_what_a_process_says(palpate, palpate_process, arguments):
    called, executed = palpate(*arguments), palpate_process(*arguments)
    assert (called.returncode, called.stdout, called.stderr) == (executed.returncode, executed.stdout, executed.stderr)


CHANGES = """
import logging, os, pathlib, signal, sys, warnings
pathlib.Path("done").touch()
os.environ["MINE"] = "1"
del os.environ["THEIRS"]
os.chdir("/")
sys.path.insert(0, "/nowhere")
sys.argv = []
for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    assert signal.getsignal(number) is not signal.SIG_IGN  # as at a terminal; an import holds Ctrl-C back
    signal.signal(number, signal.SIG_IGN)
logging.disable(logging.CRITICAL)
logging.getLogger().addHandler(logging.NullHandler())
warnings.simplefilter("ignore")
"""


def state():
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM)]
    root = logging.getLogger()
    plugins = [name for name in sys.modules if name.startswith("palpate_file_")]
    loggers = (root.manager.disable, root.level, root.handlers[:])
    streams = (sys.stdin, sys.stdout, sys.stderr)
    return (
        os.getcwd(),
        dict(os.environ),
        sys.argv,
        sys.path[:],
        handlers,
        loggers,
        warnings.filters[:],
        plugins,
        streams,
    )


@pytest.mark.slow
def test_a_call_leaves_nothing_behind(palpate, point_pipeline, tmp_path, monkeypatch):
    monkeypatch.setenv("THEIRS", "1")
    (tmp_path / "mine.py").write_text(CHANGES)
    with ignored(signal.SIGINT, signal.SIGHUP):
        before = state()
        assert palpate("--plugin", tmp_path / "mine.py", "check", point_pipeline, MINE="2").returncode == 0
        assert state() == before
    assert (tmp_path / "done").exists()


@pytest.mark.slow
def test_modules_of_pythonpath_are_those_of_one_call(palpate, tmp_path):
    info = tmp_path / "mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[palpate]\nmine = mine_tip\n")
    for name in ("one", "three"):  # of another length, which compiled code of the same second is known by
        (tmp_path / "mine_tip.py").write_text(
            "from palpate import plugin\nfrom palpate_models import Sphere\n"
            f"@plugin\ndef palpate_indenters():\n    return {{'tip-{name}': Sphere}}\n"
        )
        assert f"tip-{name}" in palpate("list", PYTHONPATH=tmp_path).stdout
    assert "tip-three" not in palpate("list").stdout


@pytest.mark.slow
def test_the_command_itself():
    done = run(PALPATE, "--version")
    assert (done.returncode, done.stdout[:8]) == (0, "palpate ")
