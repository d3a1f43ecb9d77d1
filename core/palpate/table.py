"""A table of cells: what people see, whether on a terminal, in a report or in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType


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
