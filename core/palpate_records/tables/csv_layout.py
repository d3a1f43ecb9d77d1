"""Where in a table the numbers begin, and what the lines above them say: names, units, values about the experiment."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import IO, TypeVar

from palpate import LogError

from palpate_records.tables.cell_units import number_and_unit
from palpate_records.tables.cells import POINTS, has_decimal_comma
from palpate_records.tables.csv_names import is_electrical, is_unit, plain_unit
from palpate_records.tables.dialect import MARKS, Dialect, is_blank, is_clock
from palpate_records.tables.table_text import bounded_lines

Row = TypeVar("Row")
LINES = 400  # above the first row of numbers, at most
_MANY = 50  # rows that are certainly those of the table
_TITLES = 50  # lines above the names of a page, at most
_FEW = 3  # rows that are numbers by chance: results of a test above its readings
_OTHER_UNITS = re.compile(r"%|-|°?C|[kMG]?Pa|mm/mm|mJ|J|deg|#|hh:mm:ss.*", re.IGNORECASE)
# A line between header and rows: of dashes, or a word for the end of the one or the begin of the other.
_DIVIDER = re.compile(r"[\W_]+|\W*(eoh|end[ _-]?of[ _-]?header|header[ _-]?end|data|begin[ _]data)\W*", re.IGNORECASE)
_BETWEEN = re.compile(r"[:=\t;,]")
_COLUMNS, _UNITS = "columns|fields|names|column names", "units"  # what begins a comment with names, and with units
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


@dataclass(frozen=True)
class _RowBlock:
    """Rows of numbers, one below the other."""

    begin: int
    rows: int
    width: int
    numbers: int  # cells of a row that are numbers


def one_table(
    rows: Iterable[Row],
    layout: TableLayout,
    dialect: Dialect,
    cells_of: Callable[[Row], list[str]],
    pages: Callable[[], int],
) -> Iterator[Row]:
    """The rows of a table, up to the title of another one with the same names, but for the heads of its own pages.

    `pages` is how many it has, 0 if nothing is known of tables below it, whose heads are rows then.
    """
    names = [name.strip() for name in layout.names or ()]
    above: list[Row] = []  # rows without readings, perhaps the title of the next page
    page, is_head = 1, False
    for row in rows:
        cells = cells_of(row)
        if len(above) == _TITLES or any(dialect.is_value(cells[k]) for k in layout.numbers if k < len(cells)):
            yield from above
            above.clear()
            is_head = False
            yield row
        elif names and [cell.strip() for cell in cells] == names and pages():
            page, is_head = page + 1, True
            if page > pages():
                yield from (row for row in above if sum(map(bool, map(str.strip, cells_of(row)))) > 1)
                return
            above.clear()
        elif not is_head:
            above.append(row)
    yield from above


def first_lines(file: IO[str], path: Path, below: int = 0) -> list[str]:
    """The lines by which a layout is found, those below a stated one."""
    return [line.replace("\0", "") for line in islice(bounded_lines(file, path), LINES + below)]


def layout_of(
    path: Path, lines: Sequence[str], dialect: Dialect, header: int | None = None, units: int | None = None
) -> TableLayout:
    """The layout by the first lines of a file; the lines of `header` and `units` as stated, 0 for none.

    Raises LogError without rows of numbers.
    """
    for looked in (lines[: 2 * _MANY], lines):
        if any('"' in line for line in looked):  # each by itself: a quotation mark that stands alone spoils no other
            rows = [next(dialect.rows([line]), []) for line in looked]
        else:
            rows = list(dialect.rows(looked))
        skipped = [i for i, line in enumerate(looked) if not (text := line.lstrip()) or dialect.is_comment(text)]
        skipped += range(max(header or 0, units or 0))
        run = _rows_of_numbers(rows, {*skipped}, dialect)
        if run is not None and run.rows >= _MANY and run.numbers >= 2:  # which more lines do not change
            break
    stated: tuple[str, ...] | None = None
    _refuse_numbers_above(path, rows, {*skipped}, run, dialect)
    if run is None:
        raise LogError(f"{path}: the file contains no rows of numbers")
    names_at, units_at = _lines_above(path, lines, rows, run, dialect, header, units)
    names, groups = (None, ()) if names_at is None else _names(lines, names_at, run, dialect)
    if header is None and (named := _stated_cells(lines[: run.begin], _COLUMNS, run.width)) is not None:
        names, names_at, units_at = named, None, None
    if names_at is None and units is None:
        stated = _stated_cells(lines[: run.begin], _UNITS, run.width)
    below = _cells(lines[units_at], dialect, run.width) if units_at is not None else []
    below = [*names] if names and units_at is None and _are_units(names) else below
    below = [*stated] if stated else below
    top = min((at for at in (names_at, units_at) if at is not None), default=run.begin)
    first = rows[run.begin]
    return TableLayout(
        run.begin,
        run.width if names is None else min(run.width, len(names)),
        names,
        tuple(plain_unit(cell) for cell in below),
        0 if units_at is None else units_at + 1,
        tuple(fact for i, line in enumerate(lines[:top]) if (fact := _fact(i + 1, line, dialect)) is not None),
        frozenset(k for k, cell in enumerate(first) if is_clock(cell) and not dialect.is_number(cell)),
        frozenset(k for k, cell in enumerate(first) if dialect.is_value(cell)),
        tuple(number_and_unit(cell)[1] for cell in first),
        groups,
    )


def _rows_of_numbers(rows: Sequence[Sequence[str]], skipped: set[int], dialect: Dialect) -> _RowBlock | None:
    """The longest run, from its first row on: what stands above a line that does not fit is not left out."""
    runs: list[_RowBlock] = []
    begin, width, count, most = 0, -1, 0, 0
    for i, cells in enumerate([*rows, []]):
        if i in skipped and i < len(rows):
            continue
        numbers = sum(map(dialect.is_value, cells))
        if numbers and len(cells) == width:
            count, most = count + 1, max(most, numbers)
            if count < _MANY or most < 2:
                continue
        if count:
            runs.append(_RowBlock(begin, count, width, most))
        if count >= _MANY and most >= 2:
            break
        begin, width, count, most = i, len(cells) if numbers else -1, int(numbers > 0), numbers
    if not runs:
        return None
    best = max(runs, key=lambda run: (run.numbers >= 2, run.rows))
    before = [run for run in runs if run.begin < best.begin and run.width == best.width and run.numbers >= best.numbers]
    for run in before:
        between = rows[run.begin + run.rows : best.begin]
        if run.rows >= _FEW or not any(_is_header(cells, dialect) for cells in between):
            best = run
            break
    begin = best.begin
    while begin and begin - 1 not in skipped and len(rows[begin - 1]) == best.width > 1 and not any(rows[begin - 1]):
        begin -= 1  # a row of empty cells is one of readings that are missing
    return replace(best, begin=begin)


def _refuse_numbers_above(
    path: Path, rows: Sequence[Sequence[str]], skipped: set[int], run: _RowBlock | None, dialect: Dialect
) -> None:
    """Raise LogError for lines above the rows of numbers that may be such rows, too."""
    above = [i for i in range(run.begin if run else len(rows)) if i not in skipped]
    if dialect.decimal == ".":
        for i in above:
            comma = next((cell for cell in rows[i] if has_decimal_comma(cell)), None)
            if comma is not None and (run is None or len(rows[i]) == run.width):
                raise LogError(f"{path}:{i + 1}: its numbers have decimal commas ({comma.strip()[:20]!r}): {POINTS}")
    if run is not None and above and dialect.is_value(next(iter(rows[above[-1]]), "")):
        raise LogError(
            f"{path}:{above[-1] + 1}: the line has {len(rows[above[-1]])} cells, those below it {run.width}; "
            "header = LINE states where the names are"
        )


def _is_header(cells: Sequence[str], dialect: Dialect) -> bool:
    """Whether cells can be names or units: two texts at least, and no number."""
    filled = [cell for cell in cells if cell.strip()]
    return len(filled) >= 2 and not any(map(dialect.is_value, filled))


def _lines_above(
    path: Path,
    lines: Sequence[str],
    rows: Sequence[Sequence[str]],
    run: _RowBlock,
    dialect: Dialect,
    header: int | None,
    units: int | None,
) -> tuple[int | None, int | None]:
    """The lines of the names and of the units, counted from 0."""
    for key, at in (("header", header), ("units", units)):
        if at and any(map(dialect.is_value, _cells(lines[at - 1], dialect, run.width) if at <= len(lines) else ["0"])):
            raise LogError(
                f"{path}: {key} = {at}: that line holds numbers; rows of numbers begin in line {run.begin + 1}"
            )
    above = [i for i in range(run.begin - 1, -1, -1) if lines[i].strip() and not _DIVIDER.fullmatch(lines[i].strip())]
    found = [i for i in above[:3] if _fits(lines[i], dialect, run)]
    names_at = units_at = None
    if found and found[0] == above[0]:
        first = _cells(lines[found[0]], dialect, run.width)
        lower = len(found) > 1 and found[1] == above[1]
        if lower and _are_units(first):
            names_at, units_at = found[1], found[0]
        else:
            names_at = found[0]
    if header is not None:
        names_at = header - 1 if header else None
    if units is not None:
        units_at = units - 1 if units else None
    return names_at, units_at


def _stated_cells(lines: Sequence[str], words: str, width: int) -> tuple[str, ...] | None:
    """The cells behind a word in one of the comments above the rows, as in "# units: m N s"; None where none fits."""
    wanted = re.compile(rf"[\s{''.join(MARKS)}]+(?:{words})\s*[:=]\s*(.+)", re.IGNORECASE)
    for line in reversed(lines):
        if (match := wanted.fullmatch(line.rstrip("\r\n"))) is None:
            continue
        for cells in (re.findall(r'"[^"]*"|[^\s,;]+', match[1]), re.split(r"\s*[,;\t]\s*", match[1].strip())):
            if len(cells) == width:
                return tuple(cell.strip().strip('"') for cell in cells)
    return None


def _fits(line: str, dialect: Dialect, run: _RowBlock) -> bool:
    """Whether a line can be the names of a run's columns, or their units."""
    cells = _cells(line, dialect, run.width)
    if run.width == 1:
        return not any(map(dialect.is_value, cells))
    loose = dialect.delimiter == " " or dialect.is_comment(line)  # where a sentence has cells, too
    return _is_header(cells, dialect) and not (loose and abs(len(cells) - run.width) > 1)


def _cells(line: str, dialect: Dialect, width: int) -> list[str]:
    """The cells of a line above the numbers, without the mark of a comment; units stay with their names."""
    text = line.strip("\r\n")
    mark = next((mark for mark in MARKS if mark != dialect.delimiter and text.lstrip().startswith(mark)), "")
    text = text.lstrip().removeprefix(mark).lstrip(mark).lstrip(" ") if mark else text
    cells = [cell.strip().lstrip("\ufeff") for cell in next(dialect.rows([text]), [])]
    if dialect.delimiter != " " and len(cells) != width:
        spaced = _spaced(text)
        if mark and len(cells) == 1 and len(spaced) == width:
            return spaced
    return _spaced(text) if dialect.delimiter == " " and len(cells) != width else cells


def _spaced(text: str) -> list[str]:
    """Names between spaces, to which a unit in brackets belongs."""
    by_gap = re.split(r"\s{2,}|\t", text.strip())
    joined = re.sub(r"\s+([\[(])", r"\1", text.strip()).split()
    return by_gap if len(by_gap) > 1 and len(by_gap) >= len(joined) else joined


def _are_units(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    units = [cell for cell in filled if is_unit(cell)]
    others = [cell for cell in filled if is_electrical(cell) or _OTHER_UNITS.fullmatch(plain_unit(cell))]
    return len(units) >= 1 and len({*units, *others}) == len({*filled})


def _names(lines: Sequence[str], at: int, run: _RowBlock, dialect: Dialect) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of the columns, with those of a line above where they alone are not unique; and these."""
    cells = _cells(lines[at], dialect, run.width)
    above = _cells(lines[at - 1], dialect, run.width) if at and _fits(lines[at - 1], dialect, run) else []
    filled, groups = [cell for cell in cells if cell], list[str]()
    if above and len(above) <= len(cells) and len({*filled}) < len(filled):
        for k in range(len(cells)):
            groups.append(above[k] if k < len(above) and above[k] else groups[-1] if groups else "")
        cells = [f"{group} {cell}".strip() for group, cell in zip(groups, cells, strict=True)]
    return tuple(name or str(k) for k, name in enumerate(cells)), tuple(groups)


def _fact(line: int, text: str, dialect: Dialect) -> StatedValue | None:
    """A name and its value, as in "Operator: A. B." or "Diameter";"14,0";"mm"."""
    cells = [cell.strip() for cell in _cells(text, dialect, 0) if cell.strip()]
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
