"""One of several records in a table file: which of its rows and columns are its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
    pages: int = 1  # tables under each other that it goes on through
    naming: tuple[int, ...] = ()  # columns that name it
    texts: tuple[str, ...] = ()  # what these hold in its rows
    cells: tuple[int, ...] = ()  # its columns, of tables side by side
    names: tuple[str, ...] = ()  # of these

    def layout(self, whole: TableLayout) -> TableLayout:
        """Return the layout of its own cells."""
        if not self.cells:
            return whole
        units, own = (
            tuple(row[k] if k < len(row) else "" for k in self.cells) if row else ()
            for row in (whole.units, whole.cell_units)
        )
        clocks = frozenset(place for place, k in enumerate(self.cells) if k in whole.clocks)
        return replace(whole, width=len(self.cells), names=self.names, units=units, clocks=clocks, cell_units=own)

    def rows(self, rows: Iterable[TableRow]) -> Iterator[TableRow]:
        """Yield its own cells of the rows that are its own; a cell that is empty names what that above it does."""
        current = [""] * len(self.naming)
        for line, cells in rows:
            for i, k in enumerate(self.naming):
                current[i] = (cells[k].strip() if k < len(cells) else "") or current[i]
            if tuple(current) == self.texts:
                yield line, self._picked(cells)

    def _picked(self, cells: list[str]) -> list[str]:
        """Its own cells of a row; none where all are empty, since it is shorter than those next to it."""
        if not self.cells:
            return cells
        mine = [cells[k] if k < len(cells) else "" for k in self.cells]
        return mine if any(cell.strip() for cell in mine) else []
