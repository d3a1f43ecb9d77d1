"""Where in a table the numbers begin, and what the lines above them say: names, units, values about the experiment."""

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

LINES = 400  # above the first row of numbers, at most
_TITLES = 50  # lines above the names of a page, at most
_BETWEEN = re.compile(r"[:=\t;,]")
_LONGEST = 40, 60  # characters of a name and of its value


@dataclass(frozen=True)
class StatedValue:
    """A value that a file states about the experiment."""

    line: int  # counted from 1
    name: str
    value: str


@dataclass(frozen=True)
class TableLayout:
    """Where a table's numbers are, and what is above them."""

    begin: int  # lines above the first row of numbers
    width: int  # cells of a row
    names: tuple[str, ...] | None = None  # of the columns
    units: tuple[str, ...] = ()  # in the row below the names, where there is one
    units_line: int = 0  # counted from 1
    facts: tuple[StatedValue, ...] = ()
    clocks: frozenset[int] = frozenset()  # columns of times of day
    numbers: frozenset[int] = frozenset()  # columns with one in the first row
    cell_units: tuple[str, ...] = ()  # behind the numbers of the first row
    groups: tuple[str, ...] = ()  # titles above the names, of columns whose names alone are not unique


def one_table(
    rows: Iterable[TableRow], layout: TableLayout, dialect: Dialect, pages: Callable[[], int]
) -> Iterator[TableRow]:
    """The rows of a table, up to the title of another one with the same names, but for the heads of its own pages.

    `pages` is how many it has, 0 if nothing is known of tables below it, whose heads are rows then.
    """
    names = [name.strip() for name in layout.names or ()]
    above: list[TableRow] = []  # rows without readings, perhaps the title of the next page
    page, is_head = 1, False
    for row in rows:
        _, cells = row
        if len(above) == _TITLES or any(dialect.is_value(cells[k]) for k in layout.numbers if k < len(cells)):
            yield from above
            above.clear()
            is_head = False
            yield row
        elif names and [cell.strip() for cell in cells] == names and pages():
            page, is_head = page + 1, True
            if page > pages():
                yield from (row for row in above if sum(map(bool, map(str.strip, row[1]))) > 1)
                return
            above.clear()
        elif not is_head:
            above.append(row)
    yield from above


def first_lines(file: IO[str], path: Path, below: int = 0) -> list[str]:
    """Return the lines by which a layout is found, those below a stated one."""
    return [line.replace("\0", "") for line in islice(bounded_lines(file, path), LINES + below)]


def layout_of(
    path: Path, lines: Sequence[str], dialect: Dialect, header: int | None = None, units: int | None = None
) -> TableLayout:
    """Return the layout by the first lines of a file; the lines of `header` and `units` as stated, 0 for none.

    Raises LogError without rows of numbers.
    """
    rows, block = _rows_and_block(path, lines, dialect, max(header or 0, units or 0))
    top = TopLines(path, lines, block, dialect, header, units)
    names, groups = with_groups(top) if top.names.cells else (None, ())
    first_row = rows[block.begin]
    top_line = min((one.line for one in (top.names, top.unit_row) if one.line is not None), default=block.begin)
    facts = (_fact(i + 1, line, dialect) for i, line in enumerate(lines[:top_line]))
    return TableLayout(
        block.begin,
        block.width if names is None else min(block.width, len(names)),
        names,
        tuple(plain_unit(cell) for cell in top.unit_row.cells),
        0 if top.unit_row.line is None else top.unit_row.line + 1,
        tuple(fact for fact in facts if fact is not None),
        frozenset(k for k, cell in enumerate(first_row) if is_clock(cell) and not dialect.is_number(cell)),
        frozenset(k for k, cell in enumerate(first_row) if dialect.is_value(cell)),
        tuple(number_and_unit(cell)[1] for cell in first_row),
        groups,
    )


def _rows_and_block(path: Path, lines: Sequence[str], dialect: Dialect, above: int) -> tuple[list[list[str]], RowBlock]:
    """Return the cells of the first lines, and the rows of numbers below `above` lines; raises LogError without any."""
    for looked in (lines[: 2 * ENOUGH_ROWS], lines):
        if any('"' in line for line in looked):  # each by itself: a quotation mark that stands alone spoils no other
            rows = [next(dialect.rows([line]), []) for line in looked]
        else:
            rows = list(dialect.rows(looked))
        skipped = {i for i, line in enumerate(looked) if not (text := line.lstrip()) or dialect.is_comment(text)}
        skipped |= {*range(above)}
        block = block_of_rows(rows, skipped, dialect)
        if block is not None and block.is_certain:
            break
    refuse_numbers_above(path, rows, skipped, block, dialect)
    if block is None:
        raise LogError(f"{path}: the file contains no rows of numbers")
    return rows, block


def _fact(line: int, text: str, dialect: Dialect) -> StatedValue | None:
    """Return a name and its value, as in "Operator: A. B." or "Diameter";"14,0";"mm"."""
    cells = [cell.strip() for cell in heading_cells(text, dialect, 0) if cell.strip()]
    if len(cells) in (2, 3) and not cells[0].endswith((":", "=")):
        words = " ".join(cells[1:])
        return StatedValue(line, cells[0][:40], words[:60]) if not is_blank(words) else None
    name, value = [*_BETWEEN.split(" ".join(cells), maxsplit=1), ""][:2]
    name, value = name.strip(), value.strip().rstrip('\t;," ')
    fits = 2 <= len(name) <= _LONGEST[0] and 1 <= len(value) <= _LONGEST[1]
    return StatedValue(line, name.strip('"'), value.strip('"')) if fits else None


def facts_worth_stating(facts: Sequence[StatedValue]) -> list[StatedValue]:
    """Those on tip, sample, operator, rate and gain, which no column holds."""
    return [fact for fact in facts if _STATED.search(fact.name)]


_STATED = re.compile(
    r"\b(tip|probe|probenbezeichnung|indenter|ball|sphere|diameter|radius|durchmesser|sample|specimen|material|operator|"
    r"user|bediener|prüfer|rate|frequency|freq|frequenz|delta_x|interval|gain|sensitivity|thickness|dicke)\b|kugel",
    re.IGNORECASE,
)
