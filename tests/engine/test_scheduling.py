"""Real-time scheduling of a live run, where it is permitted: for what watches the arm, and for nothing else."""

import os
import subprocess
import sys
import threading

import pytest
from palpate import clock
from palpate_engine.pipeline.live.scheduling import real_time_section

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no such scheduling here")


def policy():
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def policies(urgent):
    """That of a thread, and of one that it starts."""
    found = []

    def work():
        found.append(policy())
        inner = threading.Thread(target=lambda: found.append(policy()))
        inner.start()
        inner.join()

    thread = clock().thread(work, "work", urgent=urgent)
    thread.start()
    thread.join()
    return found


@pytest.mark.slow
def test_only_an_urgent_thread_has_it_and_nothing_inherits_it():
    with real_time_section(print) as text:
        if "not permitted" in text:
            pytest.skip("real-time scheduling is not permitted here")
        assert policies(urgent=True) == [os.SCHED_FIFO, os.SCHED_OTHER]
        assert policies(urgent=False) == [os.SCHED_OTHER, os.SCHED_OTHER]
        assert policy() == os.SCHED_OTHER


def test_where_it_is_not_permitted_everything_runs(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time_section(print) as text:
        assert text == "no real-time scheduling: not permitted"
        assert policies(urgent=True) == [os.SCHED_OTHER, os.SCHED_OTHER]


def test_on_a_system_without_that_limit_everything_runs(monkeypatch):
    """SIGXCPU alone does not make it: macOS has the signal, and no RLIMIT_RTTIME."""
    resource = pytest.importorskip("resource")
    monkeypatch.delattr(resource, "RLIMIT_RTTIME", raising=False)
    with real_time_section(print) as text:
        assert "real-time scheduling" in text


SPIN = """
import os, time
from palpate import clock
from palpate_engine.pipeline.live import scheduling
scheduling._SPELL = 0.2
said = []
with scheduling.real_time_section(said.append) as text:
    over = []
    def spin():
        while not over:
            pass
        over.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER)
    thread = clock().thread(spin, "spin", urgent=True)
    thread.start()
    deadline = time.monotonic() + 20
    while not said and time.monotonic() < deadline:
        time.sleep(1.0)  # the thread that takes over the interpreter is a pause of the other
    over.append(None)
    thread.join()
print(text, said, over)
"""


@pytest.mark.slow
def test_a_thread_that_does_not_pause_loses_it_and_stops_the_run():
    done = subprocess.run([sys.executable, "-c", SPIN], capture_output=True, text=True, check=True)
    if "not permitted" in done.stdout:
        pytest.skip("real-time scheduling is not permitted here")
    assert "['a thread that watches the arm computed for 0.2 s without a pause'] [None, True]" in done.stdout


CHILD = """
from palpate_kit.acquisition import computer
computer._SPELL = 200_000
computer.real_time(1)
while True:
    pass
"""


@pytest.mark.slow
def test_a_process_that_does_not_pause_is_ended():
    with real_time_section(print) as text:
        if "not permitted" in text:
            pytest.skip("real-time scheduling is not permitted here")
    done = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, check=False, timeout=60)
    assert done.returncode < 0
