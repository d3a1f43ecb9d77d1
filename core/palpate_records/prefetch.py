"""Prefetching: a thread reads, unpacks, decodes or simulates items while earlier ones are used."""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import closing
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")


class _PrefetchQueue(Generic[T]):
    """A queue of items from the thread that makes them to the one that uses them."""

    def __init__(self, items: Generator[T], max_items: int) -> None:
        self._items = items
        self._room = threading.Semaphore(max_items - 1)
        self._stopped = False
        # Each item in a tuple; the last entry is the error that was raised, or None.
        self.entries: SimpleQueue[tuple[T] | BaseException | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._make_items, name="ahead", daemon=True)
        self._thread.start()

    def _make_items(self) -> None:
        """Run the generator, in the thread, and close it."""
        last_entry = None
        try:
            with closing(self._items):
                for item in self._items:
                    self.entries.put((item,))
                    self._room.acquire()
                    if self._stopped:
                        break
        except BaseException as error:  # raised again in the thread that uses the items
            last_entry = error
        self.entries.put(last_entry)

    def make_room(self) -> None:
        """Let the thread make one more item."""
        self._room.release()

    def stop(self) -> None:
        """Stop the thread; return after the item that it makes, and the end of the generator."""
        self._stopped = True
        self._room.release()
        self._thread.join()


def ahead(items: Generator[T], most: int) -> Generator[T]:
    """Yield the items in their order, at most so many of which a thread makes before they are used.

    An error is raised in the place of its item. The generator runs and is closed in the thread, and nowhere else.
    """
    queue = _PrefetchQueue(items, most)
    try:
        while (entry := queue.entries.get()) is not None:
            if isinstance(entry, BaseException):
                raise entry
            yield entry[0]
            queue.make_room()
    finally:
        queue.stop()
