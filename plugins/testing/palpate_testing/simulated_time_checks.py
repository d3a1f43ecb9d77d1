"""A check of what devices do about time."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from palpate import Device, Trajectory
from palpate_kit.acquisition.simulated_computer import simulated_time as simulated_time
from palpate_kit.simulated_time.simulated_clock import SimulatedClock

from palpate_testing.device_checks import batches_of
from palpate_testing.failure_messages import demand

# What takes or waits for the computer's time, and what the clock has instead.
_INSTEAD = {
    "time.sleep": "clock().sleep",
    "time.monotonic": "clock().now",
    "time.monotonic_ns": "clock().now_ns",
    "time.time": "clock().epoch_ns",
    "time.time_ns": "clock().epoch_ns",
    "select.select": "clock().wait",
    "threading.Event.wait": "clock().event",
    "threading.Condition.wait": "clock().event",
    "threading.Thread.start": "clock().thread",
    "queue.Queue.get": "clock().queue",
    "SimpleQueue.get": "clock().queue",
}


def check_simulated_time(
    device: Device, trajectory: Trajectory | None = None, seed: int = 0, listen: float = 2.0
) -> None:
    """A live device uses `palpate.clock()` alone, so that it runs in simulated time as well.

    It is connected and listened to for some simulated time [s], `listen`. The first call that takes or waits for the
    computer's own time, such as `time.sleep`, is named with its file and line, and is not made. For a device that
    moves, give a short trajectory.
    """
    name = type(device).__name__
    demand(device.live, f"{name} is not live: it follows no clock")
    complaints: list[str] = []
    failure: Exception | None = None
    batches = []
    with SimulatedClock().running(), _watched(complaints):
        try:
            batches = batches_of(device, trajectory, seed, listen)
        except Exception as error:  # whatever third-party code raises, also for a call that was not made
            failure = error
    if complaints:
        raise AssertionError(f"{name}: {complaints[0]}")
    if failure is not None:
        raise failure
    demand(any(len(batch.time) for batch in batches), f"{name} sends nothing in {listen:g} s of simulated time")


@contextmanager
def _watched(complaints: list[str]) -> Iterator[None]:
    """Complain about calls by the code of devices, in this thread and in those that start within the context."""

    def look(frame: FrameType, event: str, called: Any) -> None:
        if event == "c_call":
            name, caller = ".".join(filter(None, (called.__module__, called.__qualname__))), frame
        elif event == "call" and frame.f_back is not None:
            name, caller = f"{frame.f_globals.get('__name__')}.{frame.f_code.co_qualname}", frame.f_back
        else:
            return
        if name in _INSTEAD and not _is_exempt(caller):
            where = f"{caller.f_code.co_filename}:{caller.f_lineno}"
            complaints.append(f"{where} calls {name}: palpate's {_INSTEAD[name]} runs in simulated time, too")
            raise AssertionError(complaints[-1])

    before, before_of_threads = sys.getprofile(), threading.getprofile()
    sys.setprofile(look)
    threading.setprofile(look)
    try:
        yield
    finally:
        sys.setprofile(before)
        threading.setprofile(before_of_threads)


def _is_exempt(caller: FrameType) -> bool:
    """Return True if code is the clock's own, or of the standard library, which may date what it logs."""
    name = str(caller.f_globals.get("__name__"))
    own = ("palpate.", "palpate_engine.", "palpate_kit.simulated_time.")
    return name.startswith(own) or name.partition(".")[0] in sys.stdlib_module_names
