"""The processes that fit: one that is warm for the curve that is looked at, and more of them for many curves."""

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

_MANY = 100  # curves that are worth a further process, which imports for seconds
_TOGETHER = 8  # curves that a further process is given at once
_Answer = TypeVar("_Answer")


def end_with_parent() -> None:
    """Let this process end when the one that started it does, even by a kill."""
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True, name="parent").start()


class Worker:
    """A process that fits, and a new one where it was killed."""

    def __init__(self) -> None:
        self._pool = self._begun()

    @staticmethod
    def _begun() -> ProcessPoolExecutor:
        pool = process_pool(1, end_with_parent)
        pool.submit(prepare_process)  # so that the first curve need not wait for it
        return pool

    async def call(self, function: Callable[..., _Answer], *arguments: Any) -> _Answer:
        """What a function finds there; raises BrokenProcessPool where the process was killed."""
        try:
            return await asyncio.wrap_future(self._pool.submit(function, *arguments))
        except BrokenProcessPool:
            self._pool = self._begun()
            raise

    def close(self) -> None:
        """End it without waiting."""
        self._pool.shutdown(wait=False, cancel_futures=True)


class Refits:
    """Many curves on their way, a question about one of them before all that wait."""

    def __init__(self, first: Worker, take: Callable[[list[Row]], None], workers: int | None) -> None:
        self._first, self._take = first, take
        self._workers = workers or core_count()
        self._left: deque[tuple[CurveReader, Curve]] = deque()
        self.running = self.cancelled = False
        self.done = self.count = 0

    async def fit(self, curves: Iterable[tuple[CurveReader, Curve]]) -> None:
        """Fit curves, each by its reader, until all are done or it is cancelled."""
        self._left = deque(curves)
        self.done, self.count, self.running, self.cancelled = 0, len(self._left), True, False
        more = [Worker() for _ in range(min(self._workers - 1, self.count // _MANY))]
        try:
            await asyncio.gather(self._drain(self._first, 1), *(self._drain(worker, _TOGETHER) for worker in more))
        finally:
            self.running = False
            for worker in more:
                worker.close()

    def cancel(self) -> None:
        """Begin no further curve; what is done stays."""
        self.cancelled = True
        self._left.clear()

    async def _drain(self, worker: Worker, most: int) -> None:
        """Have a process fit what is left, a portion of one reader after the other."""
        while self._left:
            reader, curve = self._left.popleft()
            portion = [curve]
            while len(portion) < most and self._left and self._left[0][0] == reader:
                portion.append(self._left.popleft()[1])
            try:
                found = await worker.call(fit_curves, reader, portion)
            except BrokenProcessPool:
                found = [await self._alone(worker, reader, one) for one in portion]
            for rows in found:
                self.done += 1
                self._take(rows)

    @staticmethod
    async def _alone(worker: Worker, reader: CurveReader, curve: Curve) -> list[Row]:
        """Fit a curve by itself after a process was killed; the one that kills it again is reported and skipped."""
        try:
            return (await worker.call(fit_curves, reader, [curve]))[0]
        except BrokenProcessPool:
            return loss_rows(reader, curve, KILLED)
