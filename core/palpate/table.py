"""What people see: a console, and tables of cells for a terminal, a report or a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


@dataclass(frozen=True)
class Table:
    """Headings and rows of texts; a heading or cell may have several lines."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[str, ...] = ()  # headings of the columns that are texts; all others are numbers, to the right

    @classmethod
    def of(cls, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[str] = ()) -> Table:
        """A table from any sequences."""
        return cls(title, tuple(headings), tuple(tuple(row) for row in rows), tuple(left))

    def view(self) -> RenderableType:
        """The table for a terminal; its texts are never taken as markup."""
        from rich.table import Table as View
        from rich.text import Text

        view = View(title=Text(self.title), title_justify="left")
        for heading in self.headings:
            text = heading in self.left
            view.add_column(Text(heading), justify="left" if text else "right", no_wrap=text)
        for row in self.rows:
            view.add_row(*(Text(cell) for cell in row))
        return view


def console(width: int = 120) -> Console:
    """A console on standard output: as wide as the terminal, or of a given width where there is none.

    Texts are never taken as markup: names come from users, logs and plugins.
    """
    from rich.console import Console

    found = Console(markup=False, emoji=False)
    return found if found.is_terminal else Console(width=width, markup=False, emoji=False)
