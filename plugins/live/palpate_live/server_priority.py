"""The priority of the page's server: a click is heard at once on a busy computer, and long work waits its turn."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from contextlib import suppress
from types import FrameType

_PRIORITY = 1  # real-time, the lowest of 1 to 99: below all that a run does
_WORK_TIME = 0.05  # [s] in one go; longer work is done at the priority of any other program: a choice
_PAUSE = 1.0  # [s] of ordinary priority after that: a choice
_NICENESS = 5  # of 0 to 19, of ordinary priority: below other programs; a choice


def raise_priority(loop: asyncio.AbstractEventLoop, spell: float = _WORK_TIME, pause: float = _PAUSE) -> None:
    """Let the loop's thread be woken before other programs from now on, where that is permitted.

    It has real-time priority. The kernel measures how long it works without waiting for anything, and signals SIGXCPU
    after a `spell` [s] (RLIMIT_RTTIME): then it is an ordinary process of low priority for a `pause` [s].
    """
    os.nice(_NICENESS)

    def yield_to_others(number: int, frame: FrameType | None) -> None:
        """Return to the ordinary priority, and to the real-time one after the pause."""
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        loop.call_soon_threadsafe(loop.call_later, pause, _schedule_first)

    with suppress(AttributeError, OSError, ValueError):
        _, hard_limit = resource.getrlimit(resource.RLIMIT_RTTIME)
        resource.setrlimit(resource.RLIMIT_RTTIME, (round(1e6 * spell), hard_limit))  # [us]
        signal.signal(signal.SIGXCPU, yield_to_others)
        _schedule_first()


def _schedule_first() -> None:
    """Schedule this process before ordinary ones, where that is permitted."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
