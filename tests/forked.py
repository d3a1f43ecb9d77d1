"""Processes of their own for tests, without a second of imports: forks of one process that has imported palpate.

`start` is `subprocess.Popen` of ``python -c CODE ARGUMENTS``, and `run` is `subprocess.run` of it: a process with its
own number, folder, environment, streams, signals and exit code. What a test says about the start itself (imports, the
first second, the interpreter's own settings) wants `subprocess`; where a variable is another that Python or a library
reads at its start, that is used here, too.
"""

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT

PALPATE = "from palpate.cli import main; main()"
PYTEST = "import pytest, sys; sys.exit(pytest.main())"  # python -m pytest
_AT_START = ("PYTHON", "LC_", "LANG", "OPENBLAS_", "OMP_", "MKL_", "LD_")
_SERVER = Path(__file__).with_name("fork_server.py").read_text()


def start(code, *arguments, stdin=None, stdout=None, stderr=None, text=False, cwd=None, env=None, session=False):
    """A process that runs a program and ends as Python would; signals are as at a terminal, whoever runs the tests."""
    arguments = list(map(str, arguments))
    env = dict(os.environ if env is None else env)
    if sys.platform == "linux" and _at_start(env) == _at_start(os.environ):
        return Forked(code, arguments, stdin, stdout, stderr, text, cwd or os.getcwd(), env, session)
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdin=stdin, stdout=stdout, stderr=stderr, text=text, cwd=cwd,
        env=env, start_new_session=session, preexec_fn=usual_signals,
    )  # fmt: skip


def run(code, *arguments, timeout=300, check=False, **options):
    """Run a program to its end, and give its exit code and what it wrote, by default as text."""
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


def _at_start(env):
    return {key: value for key, value in env.items() if key.startswith(_AT_START) and key != "PYTHONPATH"}


def usual_signals():
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


class Forked:
    """A process; what can be done with it is what tests do with a `subprocess.Popen`."""

    def __init__(self, code, arguments, stdin, stdout, stderr, text, cwd, env, session):
        self.args, self.returncode, given = [code, *arguments], None, []
        self.stdin, into = _stream(stdin, 0, "w", text, given)
        self.stdout, out = _stream(stdout, 1, "r", text, given)
        self.stderr, errors = (None, out) if stderr == STDOUT else _stream(stderr, 2, "r", text, given)
        self._status, report = os.pipe()
        words = {"code": code, "arguments": arguments, "cwd": str(cwd), "env": env, "session": session}
        try:
            self.pid = _server().fork(json.dumps(words).encode(), [into, out, errors, report])
        finally:
            for descriptor in (*given, report):
                os.close(descriptor)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.wait()
        for stream in (self.stdin, self.stdout, self.stderr):
            if stream is not None:
                stream.close()

    def poll(self):
        """The exit code, or None while it runs."""
        return self._ended(0.0)

    def wait(self, timeout=None):
        if self._ended(timeout) is None:
            raise subprocess.TimeoutExpired(self.args, timeout)
        return self.returncode

    def communicate(self, timeout=None):
        """Wait for its end, and for all that it writes until then."""
        if self.stdin is not None and not self.stdin.closed:
            self.stdin.close()
        until = None if timeout is None else time.monotonic() + timeout
        found, readers = {}, []
        for stream in (self.stdout, self.stderr):
            if stream is not None and not stream.closed:
                readers.append(threading.Thread(target=lambda s=stream: found.update({s: s.read()}), daemon=True))
                readers[-1].start()
        for reader in readers:
            reader.join(None if until is None else max(until - time.monotonic(), 0.0))
            if reader.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout)
        self.wait(None if until is None else max(until - time.monotonic(), 0.0))
        for stream in found:
            stream.close()
        return found.get(self.stdout), found.get(self.stderr)

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def _ended(self, timeout):
        if self.returncode is None and select.select([self._status], [], [], timeout)[0]:
            told = os.read(self._status, 16)
            os.close(self._status)
            assert told, "the process that forks has gone"
            self.returncode = int(told)
        return self.returncode


def _stream(wanted, number, mode, text, given):
    """Our end of a stream, where there is one, and the descriptor of the other; those to be closed are given."""
    if wanted is None:
        return None, number
    if wanted == DEVNULL:
        given.append(os.open(os.devnull, os.O_RDWR))
        return None, given[-1]
    if wanted != PIPE:
        return None, wanted if isinstance(wanted, int) else wanted.fileno()
    ends = os.pipe()
    ours, theirs = ends if mode == "r" else ends[::-1]
    given.append(theirs)
    return open(ours, mode if text else f"{mode}b", buffering=1 if text else -1), theirs


@cache
def _server():
    return _Server()


class _Server:
    """The process that forks; it ends with whoever started it."""

    def __init__(self):
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._lock = threading.Lock()
        command = [sys.executable, "-c", _SERVER, str(theirs.fileno())]
        self._process = subprocess.Popen(command, pass_fds=(theirs.fileno(),), stdin=DEVNULL, stdout=DEVNULL)
        theirs.close()
        atexit.register(self.close)
        assert self._control.recv(16) == b"ready"

    def fork(self, request, descriptors):
        """The number of a new process."""
        with self._lock:
            socket.send_fds(self._control, [request], descriptors)
            return int(self._control.recv(16))

    def close(self):
        self._control.close()
        self._process.wait()
