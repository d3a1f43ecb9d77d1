"""Curves fitted side by side, by as many processes as there are cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from itertools import islice

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, fit_curves, loss_rows
from palpate_kit.jobs.process_pool import process_pool

_TOGETHER = 16  # curves that a process is given at once
KILLED = "its process was killed: is the memory enough?"
_AHEAD = 2  # portions that wait for each process: what is held in memory does not grow with the number of curves


def on_cores(
    reader: CurveReader, curves: Iterable[Curve], workers: int, work: Callable[..., list[list[Row]]] = fit_curves
) -> Iterator[list[Row]]:
    """Yield the rows of every curve in the order of the curves, however many processes there are.

    Where a process is killed, what was under way is done again one by one; a curve that kills that process, too, is
    reported and skipped.
    """
    left = iter(curves)
    if workers <= 1:
        while portion := list(islice(left, _TOGETHER)):
            yield from work(reader, portion)
        return
    waiting: deque[tuple[list[Curve], Future[list[list[Row]]]]] = deque()
    with ExitStack() as stack:
        pool = stack.enter_context(process_pool(workers))
        while True:
            while len(waiting) < _AHEAD * workers and (portion := list(islice(left, _TOGETHER))):
                waiting.append((portion, pool.submit(work, reader, portion)))
            if not waiting:
                return
            portion, future = waiting.popleft()
            try:
                yield from future.result()
            except BrokenProcessPool:
                doubtful = [curve for again in (portion, *(other for other, _ in waiting)) for curve in again]
                yield from _one_by_one(reader, doubtful, work)
                waiting.clear()
                pool = stack.enter_context(process_pool(workers))


def _one_by_one(
    reader: CurveReader, curves: Iterable[Curve], work: Callable[..., list[list[Row]]]
) -> Iterator[list[Row]]:
    """Curves one after the other in one process, and in a new one after a curve that it does not survive."""
    left = deque(curves)
    while left:
        with process_pool(1) as pool:
            try:
                while left:
                    found = pool.submit(work, reader, [left[0]]).result()
                    left.popleft()
                    yield from found
            except BrokenProcessPool:
                yield loss_rows(reader, left.popleft(), KILLED)
