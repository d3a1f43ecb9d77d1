"""Tables of cells for a terminal, a report or a file, and the console that prints them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import typer

from palpate_kit.terminal.layout import layout, tables_in, text_of

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

_MAX_SCREEN_ROWS = 40  # that are printed of a long table: a choice
_MAX_BLOCKS = 10  # rows of a table too wide for the terminal that are printed as blocks of lines: a choice
_USUAL_WIDTH = 80  # [columns] of an output that is not a terminal, by custom
_UNLIMITED_WIDTH = 10_000  # [columns] beyond any table


_STYLES = {"good": "green", "doubtful": "yellow", "invalid": "red", "not determined": "yellow"}


def verdict_style(text: str) -> str:
    """Return the colour of a cell that holds a verdict and nothing else; empty for any other text."""
    return "yellow" if text.startswith("needs ") else _STYLES.get(text, "")


@dataclass(frozen=True)
class Table:
    """Headings and rows of texts; a heading or cell may have several lines."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[str, ...] = ()  # headings of the columns that are texts; all others are numbers, to the right
    is_plain: bool = False  # without lines between the cells
    spare: int = 0  # columns at the end that a narrow screen leaves out, the last first

    @classmethod
    def of(cls, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[str] = ()) -> Table:
        """Return a table from any sequences."""
        return cls(title, tuple(headings), tuple(tuple(row) for row in rows), tuple(left))

    def view(self) -> RenderableType:
        """Return the table for a terminal; its texts are never taken as markup."""
        from rich.table import Table as View
        from rich.text import Text

        view = View(title=Text(self.title) if self.title else None, title_justify="left")
        if self.is_plain:
            view = View(box=None, pad_edge=False, padding=(0, 2, 0, 0))
        for heading in self.headings:
            is_text = heading in self.left
            view.add_column(Text(heading), justify="left" if is_text else "right", no_wrap=is_text)
        view.__dict__["spare"] = self.spare
        for row in self.rows:
            view.add_row(*(Text(cell, style=verdict_style(cell)) for cell in row))
        return view


def shortened(table: Table, whole: bool = False) -> RenderableType:
    """Return the view of the first rows of a long table, whose title says so; of the whole one as CSV and LaTeX."""
    if whole or len(table.rows) <= _MAX_SCREEN_ROWS or layout() != "table":
        return table.view()
    title = f"{table.title}: {_MAX_SCREEN_ROWS} of {len(table.rows)} rows, all with --format csv"
    return replace(table, title=title, rows=table.rows[:_MAX_SCREEN_ROWS]).view()


def console(width: int = _USUAL_WIDTH) -> Console:
    """Return a console on standard output: as wide as the terminal, or otherwise of a given width.

    Texts are never taken as markup: names come from users, logs and plugins. A table that the terminal is too narrow
    for is printed row by row, so that nothing of it is cut.
    """
    from rich.console import Console

    class WholeTables(Console):
        """A console that prints tables whole; in another format, whatever is not a table goes to standard error."""

        def print(self, *objects: Any, **options: Any) -> None:
            """Print objects as rich does; a table that does not fit is printed row by row."""
            if (form := layout()) != "table":
                for item in objects:
                    tables = list(tables_in(item))
                    typer.echo("\n".join(text_of(table, form) for table in tables), nl=False)
                    if not tables:
                        Console(stderr=True, markup=False, emoji=False).print(item, **options)
                return
            super().print(*(_fitting(item, self) for item in objects), **options)

    # Only a terminal knows its width.
    console_of_terminal = WholeTables(markup=False, emoji=False)
    if console_of_terminal.is_terminal:
        return console_of_terminal
    return WholeTables(width=width, markup=False, emoji=False)


def _fitting(shown: Any, console: Console) -> Any:
    """Return a table without its spare columns, or row by row, where it is too wide; anything else as it is.

    `shown` is a table of rich, or a group of what may be tables; spare columns are those at the right that may be left
    out.
    """
    from rich.console import Group
    from rich.table import Table as View

    if isinstance(shown, Group):
        return Group(*(_fitting(item, console) for item in shown.renderables))
    if isinstance(shown, View):
        narrow = copy(shown)
        for spare in range(getattr(shown, "spare", 0) + 1):
            narrow.columns = shown.columns[: len(shown.columns) - spare]
            if _set_widths(narrow, console):
                return narrow
        return _row_by_row(shown)
    return shown


def _set_widths(table: Any, console: Console) -> bool:
    """Make a table as narrow as the console without cutting a number or a word; return True if that is possible.

    Rich by itself makes the widest columns narrower than their words.
    """
    from rich.measure import Measurement

    for column in table.columns:
        column.width = None
    full_width = Measurement.get(console, console.options.update(width=_UNLIMITED_WIDTH), table).maximum
    widths = [_widths(column) for column in table.columns]
    # The room that remains if each column has its least width, next to what is between the columns.
    spacing = full_width - sum(widest for _, widest in widths)
    room = console.width - spacing - sum(least_width for least_width, _ in widths)
    if room < 0:
        return False
    if full_width > console.width:
        for column, (least_width, widest) in zip(table.columns, widths, strict=True):
            column.width = min(widest, least_width + room)
            room -= column.width - least_width
    return True


def _widths(column: Any) -> tuple[int, int]:
    """Return the least width of a column, whose texts are broken between words, and its width without a break."""
    from rich.cells import cell_len

    heading = _plain(column.header)
    cells = [_plain(cell) for cell in column.cells]
    is_unbroken = column.no_wrap or column.justify == "right"
    parts = heading.split()
    for cell in cells:
        parts += cell.splitlines() if is_unbroken else cell.split()
    lines = [line for text in (heading, *cells) for line in text.splitlines()]
    return max(map(cell_len, parts), default=0), max(map(cell_len, lines), default=0)


def _plain(cell: Any) -> str:
    """Return the text of a cell without its style."""
    return str(getattr(cell, "plain", cell))


def _row_by_row(table: Any) -> RenderableType:
    """Return a table as lines "heading: cell", one block for each row; of many rows each is one paragraph."""
    from rich.text import Text

    def one_line(cell: Any) -> str:
        """Return the text of a cell without line breaks."""
        return " ".join(_plain(cell).split())

    headings = [one_line(column.header) for column in table.columns]
    has_blocks = table.row_count <= _MAX_BLOCKS
    lines = [one_line(table.title)] if table.title else []
    for row in zip(*(list(column.cells) for column in table.columns), strict=True):
        cells = [(heading, one_line(cell)) for heading, cell in zip(headings, row, strict=True)]
        parts = [f"{heading}: {cell}" if heading else cell for heading, cell in cells if cell]
        lines += ["", *parts] if has_blocks else ["; ".join(parts)]
    return Text("\n".join(lines))
