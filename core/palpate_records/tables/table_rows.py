"""The rows of a table that may hold anything, line by line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from palpate_records.tables.csv_layout import TableLayout, one_table
from palpate_records.tables.dialect import Dialect, TableRow
from palpate_records.tables.footer import without_footer
from palpate_records.tables.table_record import TableRecord


def rows_below(
    above: int,
    lines: Iterable[str],
    layout: TableLayout,
    dialect: Dialect,
    record: TableRecord | None,
    pages: Callable[[], int],
    footer: list[list[str]],
) -> Iterator[TableRow]:
    """Yield the rows of a table, or of a record in it, in lines that follow `above` rows; a comment has no cells.

    `pages` returns the number of pages of the table, as for `one_table`. A row is the number of its line, and its
    cells. The cells of lines below the table are added to `footer`.
    """
    without_comments = ("\n" if dialect.is_comment(line) else line for line in lines)
    rows = enumerate(dialect.rows(without_comments), layout.begin + above + 1)
    table_rows = without_footer(one_table(rows, layout, dialect, pages), layout.numbers, dialect, footer, above)
    return table_rows if record is None else record.rows(table_rows)
