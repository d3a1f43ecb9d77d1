"""One of several records in a table file, with its rows and columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from palpate_records.tables.csv_layout import TableLayout
from palpate_records.tables.dialect import TableRow

OF_RECORD = ("sheet", "header")  # keys of a file that a record states


@dataclass(frozen=True)
class TableRecord:
    """One of several records in a file."""

    name: str
    sheet: str | None = None  # of a workbook
    header: int | None = None  # line of its names, of tables under each other
    pages: int = 1  # tables under each other through which it continues
    naming: tuple[int, ...] = ()  # columns that name it
    texts: tuple[str, ...] = ()  # of these columns in its rows
    cells: tuple[int, ...] = ()  # its columns, of tables side by side
    names: tuple[str, ...] = ()  # of its columns

    def layout(self, whole: TableLayout) -> TableLayout:
        """Return the layout of its columns, by that of the whole table."""
        if not self.cells:
            return whole
        return replace(
            whole,
            width=len(self.cells),
            names=self.names,
            units=self._own_cells(whole.units) if whole.units else (),
            clocks=frozenset(index for index, column in enumerate(self.cells) if column in whole.clocks),
            cell_units=self._own_cells(whole.cell_units) if whole.cell_units else (),
        )

    def rows(self, rows: Iterable[TableRow]) -> Iterator[TableRow]:
        """Yield its cells of its rows; an empty cell in a column that names records stands for the one above it."""
        current_texts = [""] * len(self.naming)
        for line, cells in rows:
            for i, column in enumerate(self.naming):
                text = cells[column].strip() if column < len(cells) else ""
                current_texts[i] = text or current_texts[i]
            if tuple(current_texts) == self.texts:
                yield line, self._cells_of_row(cells)

    def _cells_of_row(self, cells: list[str]) -> list[str]:
        """Return its cells of a row; no cells if all are empty: other tables, side by side with it, are longer."""
        if not self.cells:
            return cells
        own_cells = [*self._own_cells(cells)]
        return own_cells if any(cell.strip() for cell in own_cells) else []

    def _own_cells(self, cells: Sequence[str]) -> tuple[str, ...]:
        """Return the cells of its columns; empty behind the end of the row."""
        return tuple(cells[column] if column < len(cells) else "" for column in self.cells)
