"""Rules for the names and units of a table's columns, by the lines above its rows of numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from palpate import LogError

from palpate_records.tables.csv_names import is_electrical, is_unit, plain_unit
from palpate_records.tables.dialect import MARKS, Dialect
from palpate_records.tables.number_rows import RowBlock, is_header
from palpate_records.tables.rules import Sureness, decision, rule

# Units of other columns than force, height and time; the first ones name nothing.
_PLAIN_UNITS = r"[kMG]?Pa(?:[.*·\- ]?s)?|k?Hz|rad/s"
_OTHER_UNITS = re.compile(
    rf"{_PLAIN_UNITS}|%|-|1|[^\x00-\x7f]{{0,2}}C|min|h|mJ|J|deg|#|hh:mm:ss.*|[^\s/^]+[/^]\S+", re.IGNORECASE
)
# A line between header and rows: of dashes, or a word for the end of the one or the begin of the other.
_DIVIDER = re.compile(
    r"[\W_]+|\W*(eoh|end[ _-]?of[ _-]?header|header[ _-]?end|data|begin(?:[ _]data)?)\W*", re.IGNORECASE
)
_COLUMNS, _UNITS = "columns|fields|names|column names", "units"  # begins of comments with names, and with units
_SEQUENCE, _VOLT = "sequence", "volt"  # as Rigol writes them
_MAX_HEADING_LINES = 3  # above the rows, without blank ones, in which names and units are: a choice


@dataclass(frozen=True)
class TopLines:
    """The first lines of a file, with its rows of numbers."""

    path: Path
    lines: Sequence[str]
    block: RowBlock
    dialect: Dialect
    header: int | None = None  # line of the names as a person states it, counted from 1; 0 for none
    units: int | None = None  # that of the units

    def __post_init__(self) -> None:
        """Raise LogError for a stated line that holds numbers."""
        for key, line in (("header", self.header), ("units", self.units)):
            if not line:
                continue
            cells = self.cells(line - 1) if line <= len(self.lines) else ["0"]
            if any(map(self.dialect.is_value, cells)):
                raise LogError(
                    f"{self.path}: {key} = {line}: that line holds numbers; rows of numbers begin in line "
                    f"{self.block.begin + 1}"
                )

    def cells(self, line: int) -> list[str]:
        """Return the cells of a line, counted from 0."""
        return heading_cells(self.lines[line], self.dialect, self.block.width)

    def fits(self, line: int) -> bool:
        """Return True for a line that can be the names of the columns, or their units."""
        cells = self.cells(line)
        if self.block.width == 1:
            return not any(map(self.dialect.is_value, cells))
        # A sentence in a comment, or with separating spaces, has cells as well, but hardly as many as the table.
        is_loose = self.dialect.delimiter == " " or self.dialect.is_comment(self.lines[line])
        return is_header(cells, self.dialect) and not (is_loose and abs(len(cells) - self.block.width) > 1)

    @cached_property
    def headings(self) -> list[int]:
        """The lines directly above the rows that can be names or units, the lowest first."""
        lines_above = []
        for i in range(self.block.begin - 1, -1, -1):
            text = self.lines[i].strip()
            if text and not _DIVIDER.fullmatch(text):
                lines_above.append(i)
        headings: list[int] = []
        for i in lines_above[:_MAX_HEADING_LINES]:
            if not self.fits(i):
                break
            headings.append(i)
        return headings

    @cached_property
    def names(self) -> Heading:
        """The names of the columns as they are written; no cells without any."""
        return decision(NAME_RULES, self) or Heading()

    @cached_property
    def unit_row(self) -> Heading:
        """The units of the columns that stand apart from the names; no cells without any."""
        return decision(UNIT_RULES, self) or Heading()

    def comment_cells(self, pattern_of_begin: str) -> tuple[str, ...] | None:
        """Return the cells behind a word in a comment above the rows, as in "# units: m N s"; None if none fits."""
        pattern = re.compile(rf"[\s{''.join(MARKS)}]+(?:{pattern_of_begin})\s*[:=]\s*(.+)", re.IGNORECASE)
        for line in reversed(self.lines[: self.block.begin]):
            if (match := pattern.fullmatch(line.rstrip("\r\n"))) is None:
                continue
            for cells in (re.findall(r'"[^"]*"|[^\s,;]+', match[1]), re.split(r"\s*[,;\t]\s*", match[1].strip())):
                if len(cells) == self.block.width:
                    return tuple(cell.strip().strip('"') for cell in cells)
        return None


@dataclass(frozen=True)
class Heading:
    """Cells above the columns, and their line counted from 0; None for those of a comment, and without cells."""

    cells: tuple[str, ...] = ()
    line: int | None = None


@rule("header = LINE", "the names, or a table without them", Sureness.CHOSEN)
def stated_line_of_names(top: TopLines) -> Heading | None:
    """Return the names of the line that a person states."""
    if top.header is None:
        return None
    return Heading(tuple(top.cells(top.header - 1)), top.header - 1) if top.header else Heading()


@rule('a comment such as "# columns: t z F"', "the names", Sureness.STATED)
def comment_of_names(top: TopLines) -> Heading | None:
    """Return the names that a comment lists."""
    cells = top.comment_cells(_COLUMNS)
    return None if cells is None else Heading(cells)


@rule('a line "Sequence, VOLT, ..." of an oscilloscope, with the scale of its time', "the names", Sureness.STATED)
def line_above_sequence(top: TopLines) -> Heading | None:
    """Return the names above such a line, without those of the scale, which has no column."""
    line = top.block.begin - 1
    if line < 1 or [cell.lower() for cell in top.cells(line)[:1]] != [_SEQUENCE]:
        return None
    return Heading(tuple(top.cells(line - 1)[: top.block.width]), line - 1)


@rule("two lines above the rows, the lower one of units", "the names", Sureness.WORD)
def line_above_units(top: TopLines) -> Heading | None:
    """Return the names above a line of units."""
    if len(top.headings) < 2 or not are_units(top.cells(top.headings[0])):
        return None
    return Heading(tuple(top.cells(top.headings[1])), top.headings[1])


@rule("the line above the rows", "the names", Sureness.GUESS)
def line_above_rows(top: TopLines) -> Heading | None:
    """Return the names directly above the rows."""
    return Heading(tuple(top.cells(top.headings[0])), top.headings[0]) if top.headings else None


@rule("units = LINE", "the units, or a table without them", Sureness.CHOSEN)
def stated_line_of_units(top: TopLines) -> Heading | None:
    """Return the units of the line that a person states."""
    if top.units is None:
        return None
    return Heading(tuple(top.cells(top.units - 1)), top.units - 1) if top.units else Heading()


@rule('a comment such as "# units: s mm N", where the names stand in no line', "the units", Sureness.STATED)
def comment_of_units(top: TopLines) -> Heading | None:
    """Return the units that a comment lists."""
    cells = top.comment_cells(_UNITS) if top.names.line is None else None
    return None if cells is None else Heading(cells)


@rule('a line "Sequence, VOLT, ..." of an oscilloscope', "the units", Sureness.STATED)
def line_of_sequence(top: TopLines) -> Heading | None:
    """Return the units in such a line; the rows are counted, and have none."""
    if line_above_sequence(top) is None:
        return None
    line = top.block.begin - 1
    units = ("V" if cell.lower() == _VOLT else cell for cell in top.cells(line)[1 : top.block.width])
    return Heading(("", *units), line)


@rule("a line of units below that of the names", "the units", Sureness.WORD)
def line_below_names(top: TopLines) -> Heading | None:
    """Return the units between names and rows, unless a comment has the names."""
    if top.header is None and comment_of_names(top) is not None:
        return None
    names = line_above_units(top)
    return Heading(tuple(top.cells(top.headings[0])), top.headings[0]) if names is not None else None


@rule("names that are units themselves", "the units", Sureness.GUESS)
def units_in_place_of_names(top: TopLines) -> Heading | None:
    """Return names that are nothing but units."""
    cells = top.names.cells
    return Heading(cells) if cells and are_units(cells) else None


NAME_RULES = (stated_line_of_names, comment_of_names, line_above_sequence, line_above_units, line_above_rows)
UNIT_RULES = (stated_line_of_units, comment_of_units, line_of_sequence, line_below_names, units_in_place_of_names)


def are_units(cells: Sequence[str]) -> bool:
    """Return True for cells of which one at least is certainly a unit, and all others may be."""
    filled = [plain_unit(cell) for cell in cells if cell.strip()]
    certain = [cell for cell in filled if is_unit(cell) or re.fullmatch(_PLAIN_UNITS, cell)]
    possible = [cell for cell in filled if is_electrical(cell) or _OTHER_UNITS.fullmatch(cell)]
    return len(certain) >= 1 and {*certain, *possible} == {*filled}


def with_groups(top: TopLines) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the columns, and the titles of groups of columns from the line above them.

    `top` has the lines above the numbers, with the one of the names. Titles are put before names only if these alone
    are not unique; else none is returned.
    """
    names = list(top.names.cells)
    line = top.names.line
    cells_above = top.cells(line - 1) if line and top.fits(line - 1) else []
    filled_names = [name for name in names if name]
    groups = list[str]()
    if cells_above and len(cells_above) <= len(names) and len({*filled_names}) < len(filled_names):
        # A title stands above the first column of its group.
        title = ""
        for k in range(len(names)):
            if k < len(cells_above) and cells_above[k]:
                title = cells_above[k]
            groups.append(title)
        names = [f"{group} {name}".strip() for group, name in zip(groups, names, strict=True)]
    return tuple(name or str(k) for k, name in enumerate(names)), tuple(groups)


def heading_cells(line: str, dialect: Dialect, width: int) -> list[str]:
    """Return the cells of a line above the numbers, without the mark of a comment; units stay with their names."""
    text = line.strip("\r\n")
    mark = next((mark for mark in MARKS if mark != dialect.delimiter and text.lstrip().startswith(mark)), "")
    if mark:
        text = text.lstrip().removeprefix(mark).lstrip(mark).lstrip(" ")
    cells = [cell.strip().lstrip("\ufeff") for cell in next(dialect.rows([text]), [])]
    if len(cells) == width:
        return cells
    spaced_names = _spaced_names(text, width)
    # A comment may have names between spaces, whatever stands between the numbers.
    is_spaced_comment = bool(mark) and len(cells) == 1 and len(spaced_names) == width
    return spaced_names if dialect.delimiter == " " or is_spaced_comment else cells


def _spaced_names(text: str, width: int) -> list[str]:
    """Return names between spaces, which belong to a unit in brackets behind them; as many as columns if possible."""
    names_by_gap = re.split(r"\s{2,}|\t", text.strip())
    names_by_space = re.sub(r"\s+([\[(])", r"\1", text.strip()).split()
    names_by_unit = re.split(r"(?<=[\])])\s+", text.strip())  # "Height (m) Vertical Deflection (N)"
    if len(names_by_space) != width:
        for names in (names_by_gap, names_by_unit):
            if len(names) == width > 1:
                return names
    return names_by_gap if len(names_by_gap) > 1 and len(names_by_gap) >= len(names_by_space) else names_by_space
