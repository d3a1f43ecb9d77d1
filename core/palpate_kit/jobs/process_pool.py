"""Pools of fresh processes, which import nothing from the current folder."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from palpate_engine import safe_processes


class _SafeProcess(SpawnProcess):
    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  (multiprocessing calls it so)
        with safe_processes():
            return SpawnProcess._Popen(process_obj)


class _SafeContext(SpawnContext):
    Process = _SafeProcess


def process_pool(count: int, initializer: Callable[[], object] | None = None) -> ProcessPoolExecutor:
    """A pool of so many processes, none of them forked: forking a process with threads is asking for trouble."""
    with safe_processes():
        resource_tracker.ensure_running()
    return ProcessPoolExecutor(count, mp_context=_SafeContext(), initializer=initializer)
