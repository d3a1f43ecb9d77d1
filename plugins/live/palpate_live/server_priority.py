"""The priority of the page's server: a click is heard at once on a busy computer, and long work waits its turn."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from contextlib import suppress
from types import FrameType

_PRIORITY = 1  # real-time, and below all that a run does
_SPELL = 0.05  # [s] of work in one go; what takes longer is done as any other program's
_PAUSE = 1.0  # [s] until the next try
_NICE = 5


def attend(loop: asyncio.AbstractEventLoop, spell: float = _SPELL, pause: float = _PAUSE) -> None:
    """From now on the loop's thread is woken before other programs, where that is permitted.

    The kernel measures how long it works without waiting for anything, and says so after a `spell` [s]: then it is
    an ordinary process of low priority for a `pause` [s].
    """
    os.nice(_NICE)

    def yield_to_others(number: int, frame: FrameType | None) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        loop.call_soon_threadsafe(loop.call_later, pause, _first)

    with suppress(AttributeError, OSError, ValueError):
        _, hard = resource.getrlimit(resource.RLIMIT_RTTIME)
        resource.setrlimit(resource.RLIMIT_RTTIME, (round(1e6 * spell), hard))
        signal.signal(signal.SIGXCPU, yield_to_others)
        _first()


def _first() -> None:
    with suppress(OSError):  # not permitted
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
