"""A live run among other programs: what can be done so that they do not hold it up."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from palpate.clocks import clock

_PRIORITY = 20  # below that of robots and sensors


@contextmanager
def real_time_section() -> Iterator[str]:
    """Freeze the garbage collector, switch threads quickly, take real-time priority; report whether that was had."""
    if clock().simulated:
        yield "simulated time"
        return
    before = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(0.0005)
    said = _scheduled(_PRIORITY)
    try:
        yield said
    finally:
        _scheduled(0)
        sys.setswitchinterval(before)
        gc.unfreeze()


def _scheduled(priority: int) -> str:
    """Real-time scheduling of this process, where that is permitted; 0 gives it back.

    Of all its threads, those that write as well: one that waits for a core and holds the interpreter's lock makes every
    other one wait. Those that they start inherit it.
    """
    try:
        policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except (AttributeError, OSError):
        return "no real-time scheduling: not permitted"
    for thread in _threads():
        with suppress(OSError):  # the thread has ended meanwhile
            os.sched_setscheduler(thread, policy, os.sched_param(priority))
    return f"real-time scheduling, SCHED_FIFO {priority}" if priority else ""


def _threads() -> list[int]:
    folder = Path("/proc/self/task")
    return [int(entry.name) for entry in folder.iterdir()] if folder.is_dir() else []
