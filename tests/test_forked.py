"""A process of the tests that is forked is as one that is executed."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.forked import DEVNULL, PALPATE, PIPE, STDOUT, run, start, usual_signals

WHAT_IT_IS = """
import json, os, resource, signal, sys, threading
import __main__
about = {
    "arguments": sys.argv, "path": sys.path, "folder": os.getcwd(), "mine": os.environ.get("MINE"),
    "streams": [(s.encoding, s.errors, s.line_buffering, s.write_through, s.isatty()) for s in
                (sys.stdin, sys.stdout, sys.stderr)],
    "signals": [repr(signal.getsignal(n))[:30] for n in range(1, 32) if n not in (9, 19)],
    "files": sorted(os.listdir("/proc/self/fd")), "threads": threading.active_count(),
    "own session": os.getsid(0) == os.getpid(), "own group": os.getpgrp() == os.getpid(),
    "main": [__main__.__name__, __main__.__spec__, hasattr(__main__, "__file__")],
    "limits": resource.getrlimit(resource.RLIMIT_NOFILE), "priority": os.nice(0), "mask": os.umask(0),
    "blocked": sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])), "scheduling": os.sched_getscheduler(0),
}
print(json.dumps(about, indent=1), flush=True)
"""


@pytest.mark.parametrize("session", [False, True])
def test_it_is_what_a_process_is(tmp_path, monkeypatch, session):
    monkeypatch.setenv("MINE", "ünd")
    given = {"stdin": DEVNULL, "stdout": PIPE, "stderr": DEVNULL, "text": True, "cwd": tmp_path}
    command = [sys.executable, "-c", WHAT_IT_IS, "one", "two words"]
    executed = subprocess.Popen(command, start_new_session=session, preexec_fn=usual_signals, **given)
    forked = start(WHAT_IT_IS, "one", "two words", session=session, **given)
    assert forked.communicate(timeout=60)[0] == executed.communicate(timeout=60)[0]
    assert forked.returncode == executed.returncode == 0


@pytest.mark.parametrize(
    ("code", "status"),
    [
        ("pass", 0),
        ("import sys; sys.exit(3)", 3),
        ("import sys; sys.exit('words')", 1),
        ("import os; os._exit(7)", 7),
        ("1 / 0", 1),
        ("import os; os.kill(os.getpid(), 9)", -9),
        ("raise KeyboardInterrupt", -2),
        ("import sys; print('x' * 10); sys.stdout = open('/dev/full', 'w'); print('x')", 120),
        ("import atexit, os; atexit.register(os._exit, 5)", 5),
        ("import threading, time; threading.Thread(target=lambda: (time.sleep(0.05), print('late'))).start()", 0),
    ],
)
def test_it_ends_as_a_process_ends(code, status):
    done = run(code)
    executed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == executed.returncode == status
    assert done.stdout == executed.stdout
    assert (done.stderr.splitlines() or [""])[-1] == (executed.stderr.splitlines() or [""])[-1]


def test_signals_reach_it_and_nothing_else():
    words = "import signal, time\nprint('there', flush=True)\ntime.sleep(60)\n"
    one, two = (start(words, stdout=PIPE, stderr=STDOUT, text=True) for _ in range(2))
    assert [process.stdout.readline() for process in (one, two)] == ["there\n"] * 2
    assert one.pid != two.pid
    one.send_signal(signal.SIGTERM)
    assert one.wait(60) == -signal.SIGTERM
    assert one.poll() == -signal.SIGTERM
    assert two.poll() is None
    one.stdout.close()
    with pytest.raises(subprocess.TimeoutExpired):
        two.wait(0.01)
    two.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in two.communicate(timeout=60)[0]
    assert two.returncode == -signal.SIGINT
    one.kill()  # it has ended


def test_what_is_written_to_it_arrives():
    process = start("for line in open(0): print(line.upper(), end='', flush=True)", stdin=PIPE, stdout=PIPE, text=True)
    process.stdin.write("ready\n")
    process.stdin.flush()
    assert process.stdout.readline() == "READY\n"
    assert process.communicate(timeout=60) == ("", None)
    assert process.returncode == 0


def test_one_that_takes_too_long_is_killed():
    began = time.monotonic()
    with pytest.raises(subprocess.TimeoutExpired):
        run("import time; time.sleep(60)", timeout=0.1)
    assert time.monotonic() - began < 30


def test_one_changes_nothing_of_another(tmp_path):
    run("import os, sys, palpate; os.environ['MINE'] = 'x'; os.chdir('/'); sys.path[:0] = ['y']; palpate.z = 1")
    words = "import os, sys, palpate; print(os.environ.get('MINE'), os.getcwd(), sys.path[0], hasattr(palpate, 'z'))"
    assert run(words, cwd=tmp_path).stdout == f"None {tmp_path}  False\n"


def test_what_python_reads_at_its_start_is_read():
    said = run("import sys; print(sys.stdout.encoding)", env={**os.environ, "PYTHONIOENCODING": "latin-1"}).stdout
    assert said == "iso8859-1\n"


def test_modules_are_looked_for_where_they_shall_be(tmp_path):
    (tmp_path / "of_mine.py").touch()
    env = {**os.environ, "PYTHONPATH": str(tmp_path)}
    words = "import of_mine, sys; print(of_mine.__file__, sorted(sys.path))"
    executed = subprocess.run([sys.executable, "-c", words], env=env, capture_output=True, text=True)
    assert run(words, env=env).stdout == executed.stdout


def test_the_command_itself():
    done = run(PALPATE, "--version")
    assert (done.returncode, done.stdout[:8]) == (0, "palpate ")
    done = run(PALPATE, "no-such-command")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
