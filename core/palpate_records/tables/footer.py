"""Lines of words in a table and below it: events, results, a summary, a mark of its end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate import printable

from palpate_records.tables.cells import is_overload
from palpate_records.tables.dialect import Dialect, TableRow, is_blank

_LINES = 200  # of a footer, at most
_ABOVE = 3  # rows of a table that has one, at least
_SHOWN = 40  # characters of a line


def without_footer(
    rows: Iterable[TableRow], numbers: frozenset[int], dialect: Dialect, footer: list[list[str]], above: int = 0
) -> Iterator[TableRow]:
    """Yield the rows of a table whose first has numbers in these columns; what is below them goes to the footer.

    A footer begins with words in the first column of numbers, or with fewer cells below an empty line, and has no row
    of readings in or below it: what goes on after a line of words may hide a loss, and is left to whoever reads it.
    So are words below fewer than three rows, `above` of which were read before.
    """
    if not numbers:
        yield from rows
        return
    first = min(numbers)
    held: list[TableRow] = []
    below = False  # an empty line
    for row in rows:
        _, cells = row
        cell = cells[first].strip() if first < len(cells) else ""
        if held or below or not dialect.is_value(cell):
            if _is_row(cells, numbers, dialect) or len(held) == _LINES:
                yield from held
                held.clear()
            elif held or (
                above >= _ABOVE and _is_filled(cells) and (below or first >= len(cells) or not _may_miss(cell))
            ):
                held.append(row)
                continue
        below = not _is_filled(cells)
        above += not below
        yield row
    footer += [cells for _, cells in held if _is_filled(cells)]


def _is_filled(cells: list[str]) -> bool:
    return any(cell.strip() for cell in cells)


def _is_row(cells: list[str], numbers: frozenset[int], dialect: Dialect) -> bool:
    """Return True if a line has readings, or marks of what is missing, in all columns of numbers."""
    mine = [cells[k].strip() for k in numbers if k < len(cells)]
    return (
        len(mine) == len(numbers)
        and any(map(dialect.is_value, mine))
        and all(_may_miss(cell) or dialect.is_value(cell) for cell in mine)
    )


def _may_miss(cell: str) -> bool:
    return is_blank(cell) or is_overload(cell) or cell.lower() == "nan"


def is_event(cells: list[str], width: int, dialect: Dialect) -> bool:
    """Return True for a line of words alone between the rows of a table that has several columns."""
    return width > 1 and len(cells) == 1 and bool(cells[0].strip()) and not dialect.is_value(cells[0])


def event_words(events: list[str]) -> str:
    """Return what is said of event lines, given by their texts."""
    what = "a line of words is" if len(events) == 1 else f"{len(events)} lines of words are"
    return f"{what} passed over: {printable(events[0].strip())[:_SHOWN]!r}"


def footer_words(footer: list[list[str]]) -> str:
    """What is said of a footer."""
    text = printable(", ".join(cell.strip() for cell in footer[0] if cell.strip()))[:_SHOWN]
    more = f" and {len(footer) - 1} more below it" if len(footer) > 1 else ""
    return f"the table ends at a line without readings: {text!r}{more}"
