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
        _make_ordinary(0)
    except (AttributeError, OSError):
        return "no real-time scheduling: not permitted"
    return f"real-time scheduling of guard and reception, SCHED_FIFO {URGENT}"


@contextmanager
def _limited_spells(stop: Callable[[str], None]) -> Iterator[None]:
    """Have the kernel signal an urgent thread of this process that computes for 2 s without a pause.

    The signal takes the priority of all threads away and stops the run. Only Linux has such a limit, and only the main
    thread can handle a signal; without a handler the signal would end the process, and none is set.
    """
    is_in_main_thread = threading.current_thread() is threading.main_thread()
    rt_time = _real_time_limit()
    if not is_in_main_thread or rt_time is None:
        yield
        return
    import resource

    def take_priority_away(_number: int, _frame: FrameType | None) -> None:
        for thread in _threads():
            with suppress(OSError):  # it has ended meanwhile
                _make_ordinary(thread)
        stop(f"a thread that watches the arm computed for {_SPELL:g} s without a pause")

    previous_limits = resource.getrlimit(rt_time)
    previous_handler = signal.signal(signal.SIGXCPU, take_priority_away)
    try:
        with suppress(OSError, ValueError):  # a hard limit of the system below 2 s stays
            resource.setrlimit(rt_time, (round(_MICROSECONDS * _SPELL), previous_limits[1]))
        yield
    finally:
        resource.setrlimit(rt_time, previous_limits)
        signal.signal(signal.SIGXCPU, previous_handler)


def _real_time_limit() -> int | None:
    """Return the resource whose limit is the time that an urgent thread computes for; None on a system without one."""
    try:
        import resource
    except ImportError:
        return None
    return getattr(resource, "RLIMIT_RTTIME", None) if hasattr(signal, "SIGXCPU") else None


def _make_ordinary(thread: int) -> None:
    """Take the real-time priority of a thread away; 0 is the calling one."""
    os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


def _threads() -> list[int]:
    """Return the system's numbers of this process's threads."""
    folder = Path("/proc/self/task")
    return [int(entry.name) for entry in folder.iterdir()] if folder.is_dir() else []
