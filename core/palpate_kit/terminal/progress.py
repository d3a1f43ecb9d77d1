"""Progress of a long piece of work: a bar on a terminal, a line every 10 s otherwise."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

_EVERY = 10.0  # [s] between two lines: a choice
_REDRAW, _BAR_WIDTH = 0.25, 60  # [s] between two bars; columns of one: a choice
_JOIN = 1.0  # [s] for a pipe that takes nothing

_shown: list[_Work] = []  # the latest is what is done within those before it


@contextmanager
def progress(doing: str, unit: str = "", total: float | None = None) -> Iterator[None]:
    """Show on standard error how far a piece of work is, as reported by `report_progress`."""
    work = _Work(doing, unit, total)
    with work.shown() if not _shown else nullcontext():
        _shown.append(work)
        try:
            yield
        finally:
            _shown.remove(work)


def report_progress(done: float, total: float | None = None, *_: object) -> None:
    """Report what is done, and of how much where that is known; nothing happens where it is not shown.

    It does as the `progress` of a pipeline's run, of which it leaves out how far the estimates are behind.
    """
    if _shown:
        _shown[-1].note(done, total)


class _Work:
    """Share of a piece of work that is done; the display reads it when it likes."""

    def __init__(self, doing: str, unit: str, total: float | None) -> None:
        self._doing, self._unit = doing, unit
        self.done, self.total = 0.0, total
        self._began = time.monotonic()

    def note(self, done: float, total: float | None) -> None:
        """Take note."""
        self.done, self.total = done, self.total if total is None else total

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show it until the context ends; a terminal or a pipe that is stuck or gone does not stop the work."""
        from rich.console import Console

        errors = Console(stderr=True, markup=False, emoji=False, highlight=False)
        ended = threading.Event()
        work = self._bar if errors.is_terminal else self._lines
        thread = threading.Thread(target=work, args=(errors, ended), daemon=True, name="progress")
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(_JOIN)

    def line(self) -> str:
        """Return all work in progress in one line."""
        parts = ", ".join(work.words() for work in _shown)
        return f"{parts}, after {time.monotonic() - self._began:.0f} s"

    def words(self) -> str:
        """Return how far it is."""
        done = f"{self.done:,.0f}".replace(",", " ")
        whole = f" of {self.total:,.0f}".replace(",", " ") if self.total else ""
        unit = f" {self._unit}" if self._unit else ""
        return f"{self._doing}: {done}{whole}{unit}" if self.done or self.total else self._doing

    def _lines(self, errors: Console, ended: threading.Event) -> None:
        with suppress(OSError, ValueError):  # ValueError: of a file that is closed
            while not ended.wait(_EVERY):
                errors.print(self.line(), soft_wrap=True)

    def _bar(self, errors: Console, ended: threading.Event) -> None:
        from rich.console import Group
        from rich.live import Live
        from rich.progress_bar import ProgressBar
        from rich.text import Text

        with suppress(OSError), Live(console=errors, auto_refresh=False, transient=True) as live:
            while not ended.wait(_REDRAW):
                bar = [ProgressBar(self.total, min(self.done, self.total), width=_BAR_WIDTH)] if self.total else []
                live.update(Group(Text(self.line()), *bar), refresh=True)
