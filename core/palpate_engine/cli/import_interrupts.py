"""Ctrl-C while modules are imported: it waits for the end of the import.

An exception within an import leaves half a module, is made another one of by what makes classes, or is printed and
ignored where a lock of the import is given back. Compiled code ignores one as well, outside of imports, where it cannot
raise it: such a press waits once more.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_LOOK = 0.01  # [s] between two looks whether the import has ended
_LONGEST = 5.0  # [s] of an import: longer ones end with the exception
_IMPORT = "<frozen importlib._bootstrap>"  # file of the frames of an import


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Within the context Ctrl-C raises KeyboardInterrupt at once, and during an import after it.

    Where it is ignored or has another handler, and outside the main thread, nothing changes.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    press, print_unraisable = _KeyPress(), sys.unraisablehook

    def repeat_ignored(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            press.wait()
        else:
            print_unraisable(unraisable)

    signal.signal(signal.SIGINT, press.take)
    sys.unraisablehook = repeat_ignored
    try:
        yield
    finally:
        press.forget()
        sys.unraisablehook = print_unraisable
        signal.signal(signal.SIGINT, signal.default_int_handler)


class _KeyPress:
    """A press of Ctrl-C, which waits for the end of an import."""

    def __init__(self) -> None:
        self._until: float | None = None  # monotonic [s]; None: nothing waits

    def take(self, number: int, frame: FrameType | None) -> None:
        """Ctrl-C was pressed."""
        if not _is_importing(frame):
            raise KeyboardInterrupt
        self.wait()

    def wait(self) -> None:
        """Look again, until the import has ended."""
        if self._until is None:
            self._until = time.monotonic() + _LONGEST
            signal.signal(signal.SIGALRM, self._look)
            signal.setitimer(signal.ITIMER_REAL, _LOOK, _LOOK)

    def _look(self, number: int, frame: FrameType | None) -> None:
        if self._until is None or (_is_importing(frame) and time.monotonic() < self._until):
            return
        self.forget()
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler) and handler not in (self.take, signal.default_int_handler):
            handler(signal.SIGINT, frame)  # of a run, which has begun meanwhile
            return
        raise KeyboardInterrupt

    def forget(self) -> None:
        """Wait for nothing any more."""
        if self._until is not None:
            self._until = None
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)


def _is_importing(frame: FrameType | None) -> bool:
    """Return True where a frame, or one that has called it, is part of an import."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False
