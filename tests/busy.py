"""Whether the machine was too busy for a test that goes by the wall clock: measured beside it, by another process.

One that sleeps for a hundredth of a second wakes late where others have the cores. A live test that fails beside such a
hold-up shows nothing of palpate: it is a skip that says so, and a failure with `--busy-fails`. A plugin of pytest.
"""

import subprocess
import sys
from subprocess import PIPE

import pytest

LIMIT = 0.1  # [s]; silence of a controller is a fault after as long
WATCH = """
import select, sys, time
over, worst, last = False, 0.0, time.monotonic()
print(worst, flush=True)
while not over:
    over = select.select([sys.stdin], [], [], 0.01)[0]
    now = time.monotonic()
    worst, last = max(worst, now - last - 0.01), now
print(worst)
"""
HELD_UP = pytest.StashKey[float]()


def pytest_addoption(parser):
    parser.addoption("--busy-fails", action="store_true", help="live tests fail on a busy machine, instead of skipping")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item):
    """What held the fixtures of a module up concerns all of its tests."""
    return (yield from _watched(item, item.getparent(pytest.Module)))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item):
    return (yield from _watched(item, item))


def _watched(item, keeper):
    if not item.get_closest_marker("live"):
        return (yield)
    with subprocess.Popen([sys.executable, "-I", "-S", "-c", WATCH], stdin=PIPE, stdout=PIPE, text=True) as watch:
        try:
            return (yield)
        finally:
            keeper.stash[HELD_UP] = max(float(watch.communicate()[0].split()[-1]), keeper.stash.get(HELD_UP, 0.0))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    held_up = max(node.stash.get(HELD_UP, 0.0) for node in (item, item.getparent(pytest.Module)))
    if report.failed and held_up > LIMIT and not item.config.option.busy_fails:
        reason = f"the machine kept a process waiting for {held_up:.2f} s, too busy for a test in real time"
        report.outcome, file, line = "skipped", item.location[0], item.location[1] or 0
        report.longrepr = file, line, f"Skipped: {reason}: {call.excinfo.exconly()}"
    return report
