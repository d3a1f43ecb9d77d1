"""Processes that fit: one that is ready for the curve on the page, and more of them for many curves."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, fit_curves, loss_rows
from palpate_kit.jobs.portions import KILLED
from palpate_kit.jobs.process_pool import core_count, process_pool

from palpate_desk.curve_answers import prepare_process

_CURVES_PER_PROCESS = 100  # a choice: so many curves are worth another process, which imports for seconds
_PORTION = 8  # curves that such a process is given at once, a choice: less overhead, but later cancelled
_Answer = TypeVar("_Answer")


def end_with_parent() -> None:
    """End this process, by a thread, when the process that started it ends, even by a kill."""
    parent = multiprocessing.parent_process()

    def wait_for_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_parent, daemon=True, name="parent").start()


class Worker:
    """Process that fits, replaced by a new one where it was killed."""

    def __init__(self) -> None:
        self._pool = self._start_process()

    @staticmethod
    def _start_process() -> ProcessPoolExecutor:
        """Return a pool of one new process."""
        pool = process_pool(1, end_with_parent)
        pool.submit(prepare_process)  # imports in advance, so that the first curve need not wait
        return pool

    async def call(self, function: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """Call a function in the process and return its result; raises BrokenProcessPool where it was killed."""
        try:
            return await asyncio.wrap_future(self._pool.submit(function, *arguments))
        except BrokenProcessPool:
            self._pool = self._start_process()
            raise

    def close(self) -> None:
        """End the process without waiting for it."""
        self._pool.shutdown(wait=False, cancel_futures=True)


class Refits:
    """Fit of many curves by several processes; the first of these also answers questions on single curves."""

    def __init__(self, first: Worker, take: Callable[[list[Row]], None], workers: int | None) -> None:
        """Prepare fits with at most so many workers (None: one for each core); `take` gets the rows of each curve."""
        self._first = first
        self._take = take
        self._max_workers = workers or core_count()
        self._pending: deque[tuple[CurveReader, Curve]] = deque()
        self.running = self.cancelled = False
        self.done = self.count = 0  # curves

    async def fit(self, curves: Iterable[tuple[CurveReader, Curve]]) -> None:
        """Fit curves, each by its reader, until all are done, or until `cancel`.

        A reader is a pipeline as plain data. For each 100 curves one more process is started, for this time.
        """
        self._pending = deque(curves)
        self.done = 0
        self.count = len(self._pending)
        self.running = True
        self.cancelled = False
        extra_workers = [Worker() for _ in range(min(self._max_workers - 1, self.count // _CURVES_PER_PROCESS))]
        try:
            # One curve at a time in the first process, so that a question waits for no more.
            await asyncio.gather(
                self._fit_pending(self._first, max_portion=1),
                *(self._fit_pending(worker, max_portion=_PORTION) for worker in extra_workers),
            )
        finally:
            self.running = False
            for worker in extra_workers:
                worker.close()

    def cancel(self) -> None:
        """Start no other curve; fits that are done stay."""
        self.cancelled = True
        self._pending.clear()

    async def _fit_pending(self, worker: Worker, max_portion: int) -> None:
        """Fit the pending curves by a process, in portions of one reader, until none is left."""
        while self._pending:
            reader, curve = self._pending.popleft()
            portion = [curve]
            while len(portion) < max_portion and self._pending and self._pending[0][0] == reader:
                portion.append(self._pending.popleft()[1])
            try:
                rows_of_curves = await worker.call(fit_curves, reader, portion)
            except BrokenProcessPool:
                rows_of_curves = [await self._fit_alone(worker, reader, curve) for curve in portion]
            for rows in rows_of_curves:
                self.done += 1
                self._take(rows)

    @staticmethod
    async def _fit_alone(worker: Worker, reader: CurveReader, curve: Curve) -> list[Row]:
        """Return the rows of a curve that is fitted by itself after the process was killed.

        A curve at which the process is killed again has rows with that error.
        """
        try:
            return (await worker.call(fit_curves, reader, [curve]))[0]
        except BrokenProcessPool:
            return loss_rows(reader, curve, KILLED)
