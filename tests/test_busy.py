"""A live test that fails while the machine holds processes up is a skip that says so, and nothing else is."""

import os
import signal
import subprocess
import sys
import time
from subprocess import PIPE

import pytest

from tests import busy

pytest_plugins = ["pytester"]
TESTS = """
import pytest

@pytest.mark.live
def test_live_and_wrong():
    assert 1 == 2

@pytest.mark.live
def test_live_and_right():
    pass

def test_wrong():
    assert 1 == 2
"""
FIXTURE = """
import pytest

@pytest.fixture(scope="module")
def job():
    {}

@pytest.mark.live
def test_one(job):
    assert job == 1

@pytest.mark.live
def test_another(job):
    assert job == 1
"""


@pytest.fixture
def outcomes(pytester, monkeypatch):
    """What becomes of tests while processes are held up for so long [s], the longest in the first phase."""

    def run(text, *held_up, options=()):
        (pytester.path / "left").write_text("\n".join(map(str, reversed(held_up))))
        said = "lines = open('left').read().split(); print(lines.pop()); open('left', 'w').write(chr(10).join(lines))"
        monkeypatch.setattr(busy, "WATCH", f"import sys; sys.stdin.read(); {said}")
        pytester.makepyfile(text)
        pytester.makeini("[pytest]\nmarkers = live")
        done = pytester.runpytest_inprocess("-rs", "-p", "no:cacheprovider", "-p", "no:xdist", *options, plugins=[busy])
        return done.parseoutcomes(), done.stdout.str()

    return run


@pytest.mark.gate
@pytest.mark.slow
def test_on_a_quiet_machine_a_failure_is_one(outcomes):
    assert outcomes(TESTS, 0, 0.02, 0, 0)[0] == {"passed": 1, "failed": 2}


@pytest.mark.gate
@pytest.mark.slow
def test_on_a_busy_machine_a_live_one_skips_and_says_why(outcomes):
    found, said = outcomes(TESTS, 0, 0.31, 0, 0.31)
    assert found == {"skipped": 1, "passed": 1, "failed": 1}
    assert "kept a process waiting for 0.31 s, too busy for a test in real time: AssertionError: assert 1 == 2" in said


@pytest.mark.gate
@pytest.mark.slow
def test_where_a_run_has_to_be_complete_it_fails_all_the_same(outcomes):
    assert outcomes(TESTS, 0, 0.31, 0, 0.31, options=["--busy-fails"])[0] == {"passed": 1, "failed": 2}


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("outcome", ["raise ValueError", "return 2"])
def test_what_held_up_a_fixture_of_the_module_concerns_all_of_its_tests(outcomes, outcome):
    assert outcomes(FIXTURE.format(outcome), 0.4, 0, 0, 0)[0] == {"skipped": 2}
    assert 0 not in outcomes(FIXTURE.format(outcome), 0, 0, 0, 0)[0].values()


def test_a_process_that_is_kept_waiting_is_measured():
    with subprocess.Popen([sys.executable, "-I", "-S", "-c", busy.WATCH], stdin=PIPE, stdout=PIPE, text=True) as watch:
        watch.stdout.readline()
        os.kill(watch.pid, signal.SIGSTOP)
        time.sleep(0.3)
        os.kill(watch.pid, signal.SIGCONT)
        assert float(watch.communicate()[0]) > 0.25
