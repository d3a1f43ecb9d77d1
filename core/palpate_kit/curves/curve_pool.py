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

_PORTION_CURVES = 16  # that a process gets at once: a choice
KILLED = "its process was killed: is the memory enough?"
_PORTIONS_AHEAD = 2  # per process: memory does not grow with the number of curves; a choice


def on_cores(
    reader: CurveReader, curves: Iterable[Curve], workers: int, work: Callable[..., list[list[Row]]] = fit_curves
) -> Iterator[list[Row]]:
    """Yield the rows of every curve in the order of the curves, whatever the number of processes.

    If a process is killed, the portions that had begun are repeated curve by curve; a curve whose process is killed
    then gets a row with that error.
    """
    remaining = iter(curves)
    if workers <= 1:
        while portion := list(islice(remaining, _PORTION_CURVES)):
            yield from work(reader, portion)
        return
    pending: deque[tuple[list[Curve], Future[list[list[Row]]]]] = deque()
    with ExitStack() as stack:
        pool = stack.enter_context(process_pool(workers))
        while True:
            while len(pending) < _PORTIONS_AHEAD * workers and (portion := list(islice(remaining, _PORTION_CURVES))):
                pending.append((portion, pool.submit(work, reader, portion)))
            if not pending:
                return
            portion, future = pending.popleft()
            try:
                yield from future.result()
            except BrokenProcessPool:
                # Nothing says whose curve killed the process: all portions that had begun are suspect.
                suspects = [*portion, *(curve for pending_portion, _ in pending for curve in pending_portion)]
                yield from _fit_one_by_one(reader, suspects, work)
                pending.clear()
                pool = stack.enter_context(process_pool(workers))


def _fit_one_by_one(
    reader: CurveReader, curves: Iterable[Curve], work: Callable[..., list[list[Row]]]
) -> Iterator[list[Row]]:
    """Yield the rows of curves that one process fits one after the other; a killed process is replaced by a new one."""
    remaining = deque(curves)
    while remaining:
        with process_pool(1) as pool:
            try:
                while remaining:
                    rows_of_curves = pool.submit(work, reader, [remaining[0]]).result()
                    remaining.popleft()
                    yield from rows_of_curves
            except BrokenProcessPool:
                yield loss_rows(reader, remaining.popleft(), KILLED)
