"""Work on many items, in portions that as many processes as there are cores take one after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from itertools import islice
from typing import TypeVar

from palpate_kit.jobs.process_pool import process_pool

Item = TypeVar("Item")
Answer = TypeVar("Answer")
KILLED = "its process was killed: is the memory enough?"
_PORTION_ITEMS = 16  # that a process gets at once: a choice
_PORTIONS_AHEAD = 2  # per process: memory does not grow with the number of items; a choice


def in_portions(
    work: Callable[[Sequence[Item]], list[Answer]],
    items: Iterable[Item],
    workers: int,
    lost: Callable[[Item], Answer],
) -> Iterator[Answer]:
    """Yield the answer to every item in the order of the items, whatever the number of processes.

    `work` answers a portion of items, in any process. If a process is killed, the portions that had begun are repeated
    item by item; an item whose process is killed then has the answer `lost`.
    """
    remaining = iter(items)
    if workers <= 1:
        for item in remaining:
            yield from work([item])
        return
    pending: deque[tuple[list[Item], Future[list[Answer]]]] = deque()
    with ExitStack() as stack:
        pool = stack.enter_context(process_pool(workers))
        while True:
            while len(pending) < _PORTIONS_AHEAD * workers and (portion := list(islice(remaining, _PORTION_ITEMS))):
                pending.append((portion, pool.submit(work, portion)))
            if not pending:
                return
            portion, future = pending.popleft()
            try:
                yield from future.result()
            except BrokenProcessPool:
                # Nothing says whose item killed the process: all portions that had begun are suspect.
                suspects = [*portion, *(item for pending_portion, _ in pending for item in pending_portion)]
                yield from _one_by_one(work, suspects, lost)
                pending.clear()
                pool = stack.enter_context(process_pool(workers))


def _one_by_one(
    work: Callable[[Sequence[Item]], list[Answer]], items: Iterable[Item], lost: Callable[[Item], Answer]
) -> Iterator[Answer]:
    """Yield the answers to items that one process takes one after the other; a killed process is replaced."""
    remaining = deque(items)
    while remaining:
        with process_pool(1) as pool:
            try:
                while remaining:
                    answers = pool.submit(work, [remaining[0]]).result()
                    remaining.popleft()
                    yield from answers
            except BrokenProcessPool:
                yield lost(remaining.popleft())
