"""The layout of a table: its first row of numbers, and above it names, units and values about the experiment."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

from palpate import LogError

from palpate_records.tables.cell_units import number_and_unit
from palpate_records.tables.csv_names import plain_unit
from palpate_records.tables.dialect import Dialect, TableRow, is_blank, is_clock
from palpate_records.tables.heading_rules import TopLines, heading_cells, with_groups
from palpate_records.tables.number_rows import ENOUGH_ROWS, RowBlock, block_of_rows, refuse_numbers_above
from palpate_records.tables.table_text import bounded_lines

# Choices.
LINES = 400  # above the first row of numbers, at most
_MAX_TITLE_LINES = 50  # above the names of a page: more rows without readings belong to the table
_MIN_FACT_NAME = 2  # characters of a name of a value about the experiment
_MAX_FACT_NAME, _MAX_FACT_VALUE = 40, 60  # characters of such a name, and of its value
_FACT_SEPARATOR = re.compile(r"[:=\t;,]")


@dataclass(frozen=True)
class StatedValue:
    """A value that a file states about the experiment."""

    line: int  # counted from 1
    name: str
    value: str


@dataclass(frozen=True)
class TableLayout:
    """The rows and columns of numbers in a table, and the names, units and values above them."""

    begin: int  # lines above the first row of numbers
    width: int  # cells of a row
    names: tuple[str, ...] | None = None  # of the columns
    units: tuple[str, ...] = ()  # in the row below the names, if there is one
    units_line: int = 0  # counted from 1
    facts: tuple[StatedValue, ...] = ()
    clocks: frozenset[int] = frozenset()  # columns of times of day
    numbers: frozenset[int] = frozenset()  # columns with a number in the first row
    cell_units: tuple[str, ...] = ()  # behind the numbers of the first row
    groups: tuple[str, ...] = ()  # titles above the names, of columns whose names alone are not unique


def one_table(
    rows: Iterable[TableRow], layout: TableLayout, dialect: Dialect, pages: Callable[[], int]
) -> Iterator[TableRow]:
    """Yield the rows of a table and its pages without the headings of these, up to the title of another table.

    A further line of the same names begins a page, or after the last page another table. Rows without readings wait,
    since they may be the title above such a line; up to `_MAX_TITLE_LINES` of them, then they are rows of the table.
    `pages` returns the number of pages; 0 if nothing is known of tables below, whose headings are rows then. It is
    called at such lines alone. A row is the number of its line, and its cells; `layout` says which columns have
    numbers, and their names, `dialect` how the text is written.
    """
    names = [name.strip() for name in layout.names or ()]
    title_rows: list[TableRow] = []  # rows without readings, perhaps the title of the next page
    page = 1
    is_heading = False  # True between the names of a page and its first row
    for row in rows:
        _, cells = row
        has_readings = any(dialect.is_value(cells[k]) for k in layout.numbers if k < len(cells))
        if has_readings or len(title_rows) == _MAX_TITLE_LINES:
            yield from title_rows
            title_rows.clear()
            is_heading = False
            yield row
        elif names and [cell.strip() for cell in cells] == names and pages():
            page += 1
            is_heading = True
            if page > pages():
                # A title has one filled cell: rows with more are the end of this table.
                yield from (title_row for title_row in title_rows if _filled_cells(title_row) > 1)
                return
            title_rows.clear()
        elif not is_heading:
            title_rows.append(row)
    yield from title_rows


def _filled_cells(row: TableRow) -> int:
    """Return the number of cells of a row that are not blank."""
    _, cells = row
    return sum(bool(cell.strip()) for cell in cells)


def first_lines(file: IO[str], path: Path, below: int = 0) -> list[str]:
    """Return the lines by which a layout is found: LINES of them, and as many more as a stated line is `below`."""
    return [line.replace("\0", "") for line in islice(bounded_lines(file, path), LINES + below)]


def layout_of(
    path: Path, lines: Sequence[str], dialect: Dialect, header: int | None = None, units: int | None = None
) -> TableLayout:
    """Return the layout by the first lines of a file; `header` and `units` are the stated lines of these, 0 for none.

    `dialect` is how the text is written: the marks between columns, of decimals and comments. Raises LogError without
    rows of numbers.
    """
    # The rows of numbers, then the names and units above them.
    rows, block = _rows_and_block(path, lines, dialect, max(header or 0, units or 0))
    top = TopLines(path, lines, block, dialect, header=header, units=units)
    names, groups = with_groups(top) if top.names.cells else (None, ())
    first_row = rows[block.begin]
    # Values about the experiment stand above names and units.
    heading_lines = [heading.line for heading in (top.names, top.unit_row) if heading.line is not None]
    top_line = min(heading_lines, default=block.begin)
    facts = (_fact(i + 1, line, dialect) for i, line in enumerate(lines[:top_line]))
    return TableLayout(
        begin=block.begin,
        width=block.width if names is None else min(block.width, len(names)),
        names=names,
        units=tuple(plain_unit(cell) for cell in top.unit_row.cells),
        units_line=0 if top.unit_row.line is None else top.unit_row.line + 1,
        facts=tuple(fact for fact in facts if fact is not None),
        clocks=frozenset(k for k, cell in enumerate(first_row) if is_clock(cell) and not dialect.is_number(cell)),
        numbers=frozenset(k for k, cell in enumerate(first_row) if dialect.is_value(cell)),
        cell_units=tuple(number_and_unit(cell)[1] for cell in first_row),
        groups=groups,
    )


def _rows_and_block(path: Path, lines: Sequence[str], dialect: Dialect, above: int) -> tuple[list[list[str]], RowBlock]:
    """Return the cells of the first lines, and where the rows of numbers below `above` lines are.

    `dialect` is how the text is written: separator, decimal mark, comments. Raises LogError without rows of numbers.
    """
    for first_part in (lines[: 2 * ENOUGH_ROWS], lines):  # a part of the lines mostly is enough
        if any('"' in line for line in first_part):
            # Each line by itself: a single quotation mark would join the lines behind it to one cell.
            rows = [next(dialect.rows([line]), []) for line in first_part]
        else:
            rows = list(dialect.rows(first_part))
        skipped = {i for i, line in enumerate(first_part) if not (text := line.lstrip()) or dialect.is_comment(text)}
        skipped |= {*range(above)}
        block = block_of_rows(rows, skipped, dialect)
        if block is not None and block.is_certain:
            break
    refuse_numbers_above(path, rows, skipped, block, dialect)
    if block is None:
        raise LogError(f"{path}: the file contains no rows of numbers")
    return rows, block


def _fact(line: int, text: str, dialect: Dialect) -> StatedValue | None:
    """Return the name and value in a line, as in "Operator: A. B." or "Diameter";"14,0";"mm"; None for any other."""
    cells = [cell.strip() for cell in heading_cells(text, dialect, 0) if cell.strip()]
    if len(cells) in (2, 3) and not cells[0].endswith((":", "=")):
        value = " ".join(cells[1:])
        return StatedValue(line, cells[0][:_MAX_FACT_NAME], value[:_MAX_FACT_VALUE]) if not is_blank(value) else None
    name, value = [*_FACT_SEPARATOR.split(" ".join(cells), maxsplit=1), ""][:2]
    name = name.strip()
    value = value.strip().rstrip('\t;," ')
    if not (_MIN_FACT_NAME <= len(name) <= _MAX_FACT_NAME and 1 <= len(value) <= _MAX_FACT_VALUE):
        return None
    return StatedValue(line, name.strip('"'), value.strip('"'))


def facts_worth_stating(facts: Sequence[StatedValue]) -> list[StatedValue]:
    """Return the values on tip, sample, operator, rate and gain, which no column holds."""
    return [fact for fact in facts if _WORTH_STATING.search(fact.name)]


_WORTH_STATING = re.compile(
    r"\b(tip|probe|probenbezeichnung|indenter|ball|sphere|diameter|radius|durchmesser|sample|specimen|material|operator|"
    r"user|bediener|prüfer|rate|frequency|freq|frequenz|delta_x|interval|gain|sensitivity|thickness|dicke)\b|kugel",
    re.IGNORECASE,
)
