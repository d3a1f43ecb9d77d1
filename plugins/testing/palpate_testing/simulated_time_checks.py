"""Check that devices use palpate's clock alone."""

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

# Calls that take or wait for the computer's time, and those of the clock in their place.
CLOCK_CALLS = {
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
    """Check that a live device uses `palpate.clock()` alone, so that it runs in simulated time as well.

    It is connected and listened to for some simulated time [s], `listen`. The first call that takes or waits for the
    computer's own time, such as `time.sleep`, is named with its file and line, and is not made. For a device that
    moves, give a short trajectory.
    """
    name = type(device).__name__
    demand(device.live, f"{name} is not live: it follows no clock")
    complaints: list[str] = []
    failure: Exception | None = None
    batches = []
    with SimulatedClock().running(), _watch_calls(complaints):
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
def _watch_calls(complaints: list[str]) -> Iterator[None]:
    """Complain about calls by the code of devices, in this thread and in those that start within the context.

    A call of `CLOCK_CALLS` is added to the complaints, and raises AssertionError before it is made.
    """

    def check_call(frame: FrameType, event: str, called: Any) -> None:
        """Check an event of Python's profiler: a call of a C function, or of the Python function of a frame."""
        if event == "c_call":
            name, caller = ".".join(filter(None, (called.__module__, called.__qualname__))), frame
        elif event == "call" and frame.f_back is not None:
            name, caller = f"{frame.f_globals.get('__name__')}.{frame.f_code.co_qualname}", frame.f_back
        else:
            return
        if name in CLOCK_CALLS and not _is_exempt(caller):
            where = f"{caller.f_code.co_filename}:{caller.f_lineno}"
            complaints.append(f"{where} calls {name}: palpate's {CLOCK_CALLS[name]} runs in simulated time, too")
            raise AssertionError(complaints[-1])

    earlier_profile, earlier_thread_profile = sys.getprofile(), threading.getprofile()
    sys.setprofile(check_call)
    threading.setprofile(check_call)
    try:
        yield
    finally:
        sys.setprofile(earlier_profile)
        threading.setprofile(earlier_thread_profile)


def _is_exempt(caller: FrameType) -> bool:
    """Return True if the caller is code of the clock, or of the standard library, which may date its logs."""
    module = str(caller.f_globals.get("__name__"))
    clock_modules = ("palpate.", "palpate_engine.", "palpate_kit.simulated_time.")
    return module.startswith(clock_modules) or module.partition(".")[0] in sys.stdlib_module_names
