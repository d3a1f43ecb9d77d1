"""Ctrl-C while modules are imported, or a library would swallow it: it waits for the end of that.

An exception within an import leaves half a module, is made another one of by what makes classes, or is printed and
ignored where a lock of the import is given back. The compiled code of pydantic and CasADi drops it, or makes an error
of its own of it, and of a destructor or a callback the interpreter itself prints and ignores it: then the press would
be lost.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_LOOK = 0.01  # [s] between two looks whether the import has ended: a choice
_LONGEST = 5.0  # [s] of an import (0531): a longer one gets the exception, and again where it swallows that
_IMPORT = "<frozen importlib._bootstrap>"  # file of the frames of an import
_SWALLOWING = tuple(f"{os.sep}{library}{os.sep}" for library in ("pydantic", "casadi"))  # in the files of their frames


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt at once within the context, and during an import after it.

    Where it is ignored or has another handler, and outside the main thread, nothing changes.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    press, hook = _KeyPress(), sys.unraisablehook

    def keep_interrupt(unraisable: sys.UnraisableHookArgs) -> None:
        """Let an interrupt wait that Python has swallowed, as in a destructor; others go to the former hook."""
        is_press = issubclass(unraisable.exc_type, KeyboardInterrupt)
        if is_press and threading.current_thread() is threading.main_thread():
            press.wait()
        else:
            hook(unraisable)

    signal.signal(signal.SIGINT, press.take)
    sys.unraisablehook = keep_interrupt
    try:
        yield
    finally:
        press.forget()
        sys.unraisablehook = hook
        signal.signal(signal.SIGINT, signal.default_int_handler)


class _KeyPress:
    """A press of Ctrl-C, which waits for the end of an import."""

    def __init__(self) -> None:
        self._until: float | None = None  # monotonic [s]; None: nothing waits
        self._was_raised = False  # within an import that takes too long

    def take(self, number: int, frame: FrameType | None) -> None:
        """Take note of Ctrl-C."""
        if not _swallows_exceptions(frame):
            raise KeyboardInterrupt
        self.wait()

    def wait(self) -> None:
        """Look again, until the import has ended."""
        if self._until is None:
            self._until = time.monotonic() + _LONGEST
            signal.signal(signal.SIGALRM, self._look)
            signal.setitimer(signal.ITIMER_REAL, _LOOK, _LOOK)

    def _look(self, number: int, frame: FrameType | None) -> None:
        """Raise the interrupt that waits, but not within code that swallows exceptions, nor once a run handles it."""
        if self._until is None:
            return
        if _swallows_exceptions(frame):
            if time.monotonic() < self._until or (self._was_raised and _is_unwinding()):
                return
            self._until, self._was_raised = time.monotonic() + _LONGEST, True
            raise KeyboardInterrupt
        was_raised = self._was_raised
        self.forget()
        if was_raised and _is_unwinding():
            return
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler) and handler not in (self.take, signal.default_int_handler):
            handler(signal.SIGINT, frame)  # of a run, which has begun meanwhile
            return
        raise KeyboardInterrupt

    def forget(self) -> None:
        """Wait for nothing any more."""
        if self._until is not None:
            self._until, self._was_raised = None, False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)


def _swallows_exceptions(frame: FrameType | None) -> bool:
    """Return True where a frame, or one that has called it, is part of an import, of pydantic or of CasADi."""
    while frame is not None:
        file = frame.f_code.co_filename
        if file == _IMPORT or any(library in file for library in _SWALLOWING):
            return True
        frame = frame.f_back
    return False


def _is_unwinding() -> bool:
    """Return True where a press that was raised is being handled, as by what ends in order."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None
