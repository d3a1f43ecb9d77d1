"""Making ahead: a thread reads, unpacks, decodes or simulates while what it has made is worked on."""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import closing
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")


class _PrefetchQueue(Generic[T]):
    """Items on their way from the thread that makes them to the one that takes them."""

    def __init__(self, items: Generator[T], most: int) -> None:
        self._items = items
        self._room = threading.Semaphore(most - 1)
        self._stopped = False
        self.found: SimpleQueue[tuple[T] | BaseException | None] = (
            SimpleQueue()
        )  # what was raised, or the end, comes last
        self._thread = threading.Thread(target=self._make, name="ahead", daemon=True)
        self._thread.start()

    def _make(self) -> None:
        last = None
        try:
            with closing(self._items):
                for item in self._items:
                    self.found.put((item,))
                    self._room.acquire()
                    if self._stopped:
                        break
        except BaseException as error:  # it is raised where the item would have come
            last = error
        self.found.put(last)

    def taken(self) -> None:
        """Make room for one more."""
        self._room.release()

    def stop(self) -> None:
        """Make no more; comes back when the last one is made and everything is closed."""
        self._stopped = True
        self._room.release()
        self._thread.join()


def ahead(items: Generator[T], most: int) -> Generator[T]:
    """Yield the items in their order, of which a thread makes at most so many before they are asked for.

    What it raises is raised in their place. The generator is run and closed in the thread, and nowhere else.
    """
    line = _PrefetchQueue(items, most)
    try:
        while (found := line.found.get()) is not None:
            if isinstance(found, BaseException):
                raise found
            yield found[0]
            line.taken()
    finally:
        line.stop()
