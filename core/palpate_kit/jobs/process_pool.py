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
_BLAS_THREADS = "OPENBLAS_NUM_THREADS"  # environment variable of the linear algebra of numpy's wheels


class _SafeProcess(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  (multiprocessing calls it so)
        with safe_processes(), _with_one_blas_thread(), _without_ctrl_c():
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
def _with_one_blas_thread() -> Iterator[None]:
    """Let processes that are started meanwhile have one thread of linear algebra, where nobody states a number.

    On small matrices a second thread waits by computing: a row of a folder takes twice the processor time.
    """
    is_stated = _BLAS_THREADS in os.environ
    os.environ.setdefault(_BLAS_THREADS, "1")
    try:
        yield
    finally:
        if not is_stated:
            del os.environ[_BLAS_THREADS]


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C wait within the context; a process that is started meanwhile hears of it from `begin_worker` on."""
    former_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former_mask)
