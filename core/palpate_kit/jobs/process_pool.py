"""Pools of fresh processes, which import nothing from the current folder and end silently at Ctrl-C."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import FrameType
from typing import Any

from palpate_engine import safe_processes

_INTERRUPTED = 128 + signal.SIGINT  # exit code


class _SafeProcess(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  (multiprocessing calls it so)
        with safe_processes(), _without_ctrl_c():
            return SpawnProcess._Popen(process_obj)


class _SafeContext(SpawnContext):
    Process = _SafeProcess


def core_count() -> int:
    """Return how many processes this one may have at work at a time."""
    return len(os.sched_getaffinity(0))


def process_pool(count: int, initializer: Callable[[], object] | None = None) -> ProcessPoolExecutor:
    """Return a pool of so many processes, none of them forked: forking a process with threads is asking for trouble."""
    with safe_processes():
        resource_tracker.ensure_running()
    return ProcessPoolExecutor(count, mp_context=_SafeContext(), initializer=begin_worker, initargs=(initializer,))


def begin_worker(initializer: Callable[[], object] | None) -> None:
    """Let Ctrl-C, which a terminal sends to every process, end this one without a word: its parent has one to say.

    It was held back while the process started and imported; a run of a pipeline takes note of it by itself.
    """
    signal.signal(signal.SIGINT, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if initializer is not None:
        initializer()


def _leave(number: int, frame: FrameType | None) -> None:
    os._exit(_INTERRUPTED)


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C wait within the context; a process that is started meanwhile hears of it from `begin_worker` on."""
    former_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former_mask)
