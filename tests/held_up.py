"""Tests on the twins fail for a reason: one that fails while the host itself stood still is done again, at most twice.

Two small processes do nothing but wake up every 5 ms, one with the priority of the servo loop, one with none; each
keeps the longest gap between two of its wakings. A failure counts as the host's where a gap beyond what any code of
ours could cause was measured during that very test, and the summary says so with the gap.
"""

import contextlib
import mmap
import os
import struct
import subprocess
import sys

import pytest
from _pytest.runner import runtestprotocol

TIMES = 2
MOST = {"real-time": 0.006, "ordinary": 0.15}  # [s] that a process of this scheduling may be kept waiting
_PERIOD = 0.005  # [s]
_WATCH = """
import mmap, os, struct, sys, time
memory, place, priority = mmap.mmap(int(sys.argv[1]), 16), 8 * int(sys.argv[2]), int(sys.argv[3])
try:
    os.sched_setscheduler(0, os.SCHED_FIFO if priority else os.SCHED_OTHER, os.sched_param(priority))
except OSError:
    pass
before, parent = time.monotonic(), os.getppid()
while os.getppid() == parent:
    time.sleep({period})
    now = time.monotonic()
    gap = now - before - {period}
    if gap > struct.unpack_from("d", memory, place)[0]:
        struct.pack_into("d", memory, place, gap)
    before = now
"""


class Watch:
    """The two processes; `gaps` since the last `forget`."""

    def __init__(self):
        descriptor = os.memfd_create("held-up")
        os.ftruncate(descriptor, 16)
        self._memory = mmap.mmap(descriptor, 16)
        code = _WATCH.format(period=_PERIOD)
        self._processes = [
            subprocess.Popen([sys.executable, "-S", "-c", code, str(descriptor), str(place), str(priority)],
                             pass_fds=(descriptor,), stdin=subprocess.DEVNULL)
            for place, priority in ((0, 45), (1, 0))
        ]  # fmt: skip
        os.close(descriptor)

    def forget(self):
        self._memory[:] = bytes(16)

    @property
    def gaps(self):
        return dict(zip(MOST, struct.unpack("dd", self._memory), strict=True))

    def close(self):
        for process in self._processes:
            process.kill()
            process.wait()


def excuse(gaps):
    """What held a test up, in words; empty where nothing did."""
    held_up = (f"{kind} {1e3 * gap:.0f} ms" for kind, gap in gaps.items() if gap > MOST[kind])
    return ", ".join(held_up)


class Repeating:
    """A plugin of pytest."""

    def __init__(self):
        self._watch, self.said = None, []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item, nextitem):
        if not any(map(item.get_closest_marker, ("live", "talks"))) or sys.platform != "linux":
            return None
        self._watch = self._watch or Watch()
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for attempt in range(TIMES + 1):
            self._watch.forget()
            reports = runtestprotocol(item, nextitem=nextitem, log=False)
            why = excuse(self._watch.gaps) if any(report.failed for report in reports) else ""
            if not why or attempt == TIMES:
                break
            self.said.append(f"{item.nodeid}: again, for the host stood still ({why}); {_last_line(reports)}")
            _afresh(item)
        for report in reports:
            if why:
                report.sections.append(("the host", f"it stood still during the last of {TIMES + 1} attempts: {why}"))
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def pytest_sessionfinish(self, session):
        if (told := getattr(session.config, "workeroutput", None)) is not None:  # a worker has no terminal
            told["held-up"] = self.said

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        self.said += getattr(node, "workeroutput", {}).get("held-up", [])

    def pytest_terminal_summary(self, terminalreporter):
        for line in self.said:
            terminalreporter.write_line(line)

    def pytest_unconfigure(self):
        if self._watch is not None:
            self._watch.close()


def _last_line(reports):
    failed = next(report for report in reports if report.failed)
    crash = getattr(failed.longrepr, "reprcrash", None)
    return f"{failed.when}: " + (crash.message if crash else str(failed.longrepr)).splitlines()[0][:200]


def _afresh(item):
    """End all fixtures, those of the module and the session as well, and let the next attempt make them anew."""
    with contextlib.suppress(Exception):  # a twin that has died cannot be ended; the report says why the test failed
        item.session._setupstate.teardown_exact(None)
    item._initrequest()
