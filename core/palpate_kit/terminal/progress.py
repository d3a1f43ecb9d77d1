"""Progress of a long piece of work: a bar on a terminal, a line every 10 s otherwise."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

# Choices.
_LINE_INTERVAL = 10.0  # [s]
_BAR_INTERVAL = 0.25  # [s]
_BAR_WIDTH = 60  # [columns]
_JOIN_TIMEOUT = 1.0  # [s] for the thread of a pipe that nobody reads

_shown: list[_Work] = []  # pieces of work in progress; each is a part of those before it


@contextmanager
def progress(doing: str, unit: str = "", total: float | None = None) -> Iterator[None]:
    """Show the progress of a piece of work on standard error, as reported by `report_progress`."""
    work = _Work(doing, unit, total)
    with work.shown() if not _shown else nullcontext():
        _shown.append(work)
        try:
            yield
        finally:
            _shown.remove(work)


def report_progress(done: float, total: float | None = None, *_: object) -> None:
    """Report the amount that is done, and the total if it is known; without effect outside of `progress`.

    It can be the `progress` of a pipeline's run, whose third argument, the backlog of the estimates, is not shown.
    """
    if _shown:
        _shown[-1].note(done, total)


class _Work:
    """A piece of work with the amount that is done, which a thread displays."""

    def __init__(self, doing: str, unit: str, total: float | None) -> None:
        self._doing = doing
        self._unit = unit
        self.done = 0.0
        self.total = total
        self._began = time.monotonic()

    def note(self, done: float, total: float | None) -> None:
        """Note the amount that is done, and the total if it is known."""
        self.done = done
        if total is not None:
            self.total = total

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the progress until the context ends; a terminal or pipe that is stuck or gone does not stop the work."""
        from rich.console import Console

        errors = Console(stderr=True, markup=False, emoji=False, highlight=False)
        ended = threading.Event()
        work = self._show_bar if errors.is_terminal else self._print_lines
        thread = threading.Thread(target=work, args=(errors, ended), daemon=True, name="progress")
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(_JOIN_TIMEOUT)

    def line(self) -> str:
        """Return all work in progress in one line."""
        parts = ", ".join(work.words() for work in _shown)
        return f"{parts}, after {time.monotonic() - self._began:.0f} s"

    def words(self) -> str:
        """Return the progress of this piece of work, as in "fit: 12 of 40 curves"."""
        done = f"{self.done:,.0f}".replace(",", " ")
        total = f" of {self.total:,.0f}".replace(",", " ") if self.total else ""
        unit = f" {self._unit}" if self._unit else ""
        return f"{self._doing}: {done}{total}{unit}" if self.done or self.total else self._doing

    def _print_lines(self, errors: Console, ended: threading.Event) -> None:
        """Print a line at intervals until the work ends."""
        with suppress(OSError, ValueError):  # ValueError is that of a closed file
            while not ended.wait(_LINE_INTERVAL):
                errors.print(self.line(), soft_wrap=True)

    def _show_bar(self, errors: Console, ended: threading.Event) -> None:
        """Draw a bar at intervals until the work ends."""
        from rich.console import Group
        from rich.live import Live
        from rich.progress_bar import ProgressBar
        from rich.text import Text

        with suppress(OSError), Live(console=errors, auto_refresh=False, transient=True) as live:
            while not ended.wait(_BAR_INTERVAL):
                bar = [ProgressBar(self.total, min(self.done, self.total), width=_BAR_WIDTH)] if self.total else []
                live.update(Group(Text(self.line()), *bar), refresh=True)
