"""Lines of words in a table and below it: events, results, a summary, a mark of the end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate import printable

from palpate_records.tables.cells import is_overload
from palpate_records.tables.dialect import Dialect, TableRow, is_blank

# Choices.
_MAX_FOOTER = 200  # lines
_MIN_ROWS = 3  # of a table that has a footer
_MAX_SHOWN = 40  # characters of a line in a message


def without_footer(
    rows: Iterable[TableRow], numbers: frozenset[int], dialect: Dialect, footer: list[list[str]], above: int = 0
) -> Iterator[TableRow]:
    """Yield the rows of a table with `numbers` in these columns of its first row; add the lines below to `footer`.

    `dialect` is how the text is written; a row is the number of its line, and its cells. A footer begins with words in
    the first column of numbers, or with fewer cells below an empty line, and has no row of readings in or below it:
    rows behind a line of words may hide a loss, so that both are passed on. So are words below fewer than three rows,
    `above` of which were read before.
    """
    if not numbers:
        yield from rows
        return
    first_column = min(numbers)
    footer_rows: list[TableRow] = []
    is_below_blank = False  # True behind an empty line
    for row in rows:
        _, cells = row
        first_cell = cells[first_column].strip() if first_column < len(cells) else None
        if footer_rows or is_below_blank or not dialect.is_value(first_cell or ""):
            can_begin = above >= _MIN_ROWS and _is_filled(cells)
            has_words = first_cell is None or not _is_missing(first_cell)
            if _is_row(cells, numbers, dialect) or len(footer_rows) == _MAX_FOOTER:
                yield from footer_rows
                footer_rows.clear()
            elif footer_rows or (can_begin and (is_below_blank or has_words)):
                footer_rows.append(row)
                continue
        is_below_blank = not _is_filled(cells)
        above += not is_below_blank
        yield row
    footer += [cells for _, cells in footer_rows if _is_filled(cells)]


def _is_filled(cells: list[str]) -> bool:
    """Return True if one of the cells is not empty."""
    return any(cell.strip() for cell in cells)


def _is_row(cells: list[str], numbers: frozenset[int], dialect: Dialect) -> bool:
    """Return True if a line has readings, or marks of missing ones, in all columns of numbers."""
    readings = [cells[k].strip() for k in numbers if k < len(cells)]
    if len(readings) < len(numbers) or not any(map(dialect.is_value, readings)):
        return False
    return all(_is_missing(cell) or dialect.is_value(cell) for cell in readings)


def _is_missing(cell: str) -> bool:
    """Return True for the mark of a missing reading."""
    return is_blank(cell) or is_overload(cell) or cell.lower() == "nan"


def is_event(cells: list[str], width: int, dialect: Dialect) -> bool:
    """Return True for a line of words alone between the rows of a table that has several columns."""
    return width > 1 and len(cells) == 1 and bool(cells[0].strip()) and not dialect.is_value(cells[0])


def event_words(events: list[str]) -> str:
    """Return a sentence on the lines of words between the rows of a table."""
    subject = "a line of words is" if len(events) == 1 else f"{len(events)} lines of words are"
    return f"{subject} passed over: {printable(events[0].strip())[:_MAX_SHOWN]!r}"


def footer_words(footer: list[list[str]]) -> str:
    """Return a sentence on the footer of a table, with its first line."""
    text = printable(", ".join(cell.strip() for cell in footer[0] if cell.strip()))[:_MAX_SHOWN]
    more = f" and {len(footer) - 1} more below it" if len(footer) > 1 else ""
    return f"the table ends at a line without readings: {text!r}{more}"
