"""Child processes for tests: Python programs with the signals of a terminal, whoever runs the tests."""

import os
import subprocess
import sys
from subprocess import DEVNULL, PIPE

PALPATE = "from palpate_engine.cli import main; main()"
PYTEST = "import pytest, sys; sys.exit(pytest.main())"  # python -m pytest
# A process inherits what is ignored: all signals under nohup, Ctrl-C in the background. By `preexec_fn` Python would
# fork beside the threads of a worker, which it warns of from 3.12 on.
_SIGNALS = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
"""


def start(code, *arguments, stdin=None, stdout=None, stderr=None, text=False, cwd=None, env=None, session=False):
    """`subprocess.Popen` of a Python program with arguments; with `session` in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", _SIGNALS + code, *map(str, arguments)],
        bufsize=1 if text else -1, stdin=stdin, stdout=stdout, stderr=stderr, text=text, cwd=cwd,
        env=None if env is None else dict(env), start_new_session=session,
    )  # fmt: skip


def run(code, *arguments, timeout=300, check=False, **options):
    """`subprocess.run` of a Python program: exit code, output and errors, by default as text."""
    options = {"stdin": DEVNULL, "stdout": PIPE, "stderr": PIPE, "text": True, **options}
    with start(code, *arguments, **options) as process:
        try:
            out, errors = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
    done = subprocess.CompletedProcess([code, *map(str, arguments)], process.returncode, out, errors)
    if check:
        done.check_returncode()
    return done


def palpate(*arguments, cwd, timeout=300, **environment):
    """The command line in a process of its own, 140 columns wide."""
    return run(PALPATE, *arguments, cwd=cwd, timeout=timeout, env={**os.environ, "COLUMNS": "140", **environment})
