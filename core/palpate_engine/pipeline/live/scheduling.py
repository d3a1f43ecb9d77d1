"""Scheduling of a live run among other programs: they do not hold it up, nor it them."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from palpate.clocks import URGENT, clock

_SPELL = 2.0  # [s] that an urgent thread may compute without a pause (0243)
_SWITCH_INTERVAL = 0.0005  # [s] of Python's threads, a tenth of its default: the guard waits for no longer; a choice
_MICROSECONDS = 1e6  # in a second, the unit of RLIMIT_RTTIME


@contextmanager
def real_time_section(stop: Callable[[str], None]) -> Iterator[str]:
    """Freeze the garbage collector and switch threads quickly; yield a sentence on the priority that urgent threads
    get.

    An urgent thread that computes for 2 s without a pause loses its priority, and `stop` is asked for.
    """
    if clock().simulated:
        yield "simulated time"
        return
    previous_interval = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        with _limited_spells(stop):
            yield _permission()
    finally:
        sys.setswitchinterval(previous_interval)
        gc.unfreeze()


def _permission() -> str:
    """Return a sentence on whether this process may have real-time scheduling: tried out, and given back."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(URGENT))
        _ordinary(0)
    except (AttributeError, OSError):
        return "no real-time scheduling: not permitted"
    return f"real-time scheduling of guard and reception, SCHED_FIFO {URGENT}"


@contextmanager
def _limited_spells(stop: Callable[[str], None]) -> Iterator[None]:
    """Let the kernel say when an urgent thread of this process has computed for too long."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGXCPU"):
        yield  # no signal can be heard: no limit, for it would end the process
        return
    import resource

    def too_long(number: int, frame: FrameType | None) -> None:
        for thread in _threads():
            with suppress(OSError):  # it has ended meanwhile
                _ordinary(thread)
        stop(f"a thread that watches the arm computed for {_SPELL:g} s without a pause")

    limits, handler = resource.getrlimit(resource.RLIMIT_RTTIME), signal.signal(signal.SIGXCPU, too_long)
    try:
        with suppress(OSError, ValueError):  # a lower limit of the system stays
            resource.setrlimit(resource.RLIMIT_RTTIME, (round(_MICROSECONDS * _SPELL), limits[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_RTTIME, limits)
        signal.signal(signal.SIGXCPU, handler)


def _ordinary(thread: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


def _threads() -> list[int]:
    folder = Path("/proc/self/task")
    return [int(entry.name) for entry in folder.iterdir()] if folder.is_dir() else []
