"""A live run among other programs: what can be done so that they do not hold it up."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_PRIORITY = 20  # below that of robots and sensors


@contextmanager
def undisturbed() -> Iterator[str]:
    """What there is now is no garbage, threads change quickly, and other programs wait; says whether they do."""
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
    """Real-time scheduling of this thread, and of those that it starts, where that is permitted; 0 gives it back."""
    try:
        policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except (AttributeError, OSError):
        return "no real-time scheduling: not permitted"
    return f"real-time scheduling, SCHED_FIFO {priority}" if priority else ""
