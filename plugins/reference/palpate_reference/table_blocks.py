"""The tables in an instrument's file: the steps of TRIOS, the intervals of RheoCompass, or one table with a header."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate import LogError
from palpate_records.tables.csv_names import plain_unit
from palpate_records.tables.heading_rules import TopLines
from palpate_records.tables.number_rows import RowBlock
from palpate_records.tables.rules import Sureness, decision, rule

from palpate_reference.instrument_text import InstrumentText, TextLine

TRIOS, RHEOCOMPASS, SIGNALS, GENERIC = "TRIOS", "RheoCompass", "Universal Analysis", "table"
_SIGNAL, _DATA = re.compile(r"sig\d+\b[\s:]*", re.IGNORECASE), "startofdata"
_ABOUT = 40  # lines that name the instrument
_STEP, _INTERVAL, _NAMES, _RESULT = "[step]", "interval and data points:", "interval data:", "result:"
_VARIABLES, _POINTS, _POINT = "variables", "number of points", "data point"  # of a step in the LIMS form of TRIOS
_COMMENT = "#%"
_SHEAR = re.compile(r"rheometer|\bARES|\bARG2\b|\bAR-|\bAR\s?\d|Discovery HR|\bDHR|\bHR-?\d", re.IGNORECASE)
_TENSILE = re.compile(r"\bRSA|\bDMA|\bQ800\b", re.IGNORECASE)


@dataclass(frozen=True)
class TableBlock:
    """One table: its names, units and rows."""

    format: str
    title: str
    names: tuple[str, ...]
    names_line: int  # counted from 1; 0 without names
    units: tuple[str, ...]  # as in the row below the names; empty without one
    rows: tuple[TextLine, ...]
    shear: bool | None = None  # what the file says of its instrument; None where it says nothing


def table_blocks(text: InstrumentText) -> list[TableBlock]:
    """Return every table of a file; raises LogError if it has none."""
    blocks = decision(FORMAT_RULES, text)
    if not blocks:
        raise LogError(f"{text.path}: the file contains no table: no two numbers stand in one line")
    return blocks


@rule("a line [step]", "the steps of TRIOS", Sureness.STATED)
def trios(text: InstrumentText) -> list[TableBlock] | None:
    """Return the steps of a file of TRIOS."""
    first = text.first_cells
    return list(_trios(text, first)) if _STEP in first else None


@rule("lines Sig1, ... and StartOfData", "the table of a Q800 and its like", Sureness.STATED)
def universal_analysis(text: InstrumentText) -> list[TableBlock] | None:
    """Return the table of a file of Universal Analysis."""
    first = text.first_cells
    return list(_signals(text, first)) if any(map(_SIGNAL.match, first)) and _DATA in first else None


@rule("a line Interval and data points", "the intervals of RheoCompass", Sureness.STATED)
def rheocompass(text: InstrumentText) -> list[TableBlock] | None:
    """Return the intervals of a file of RheoCompass."""
    first = text.first_cells
    return list(_rheocompass(text, first)) if _INTERVAL in first else None


@rule("the first row of numbers", "one table with the names above it", Sureness.GUESS)
def one_table(text: InstrumentText) -> list[TableBlock] | None:
    """Return the table of any other file."""
    return list(_generic(text))


FORMAT_RULES = (trios, universal_analysis, rheocompass, one_table)


def _trios(text: InstrumentText, first: Sequence[str]) -> Iterator[TableBlock]:
    """Steps: the line ``[step]``, its title, names, units, and rows up to an empty line; or the LIMS form of them."""
    begins = [k for k, cell in enumerate(first) if cell == _STEP]
    about = " ".join(" ".join(line.cells[:2]) for line in text.lines[: begins[0]] if "nstrument" in line.cell(0))
    shear = True if _SHEAR.search(about) else False if _TENSILE.search(about) else None
    for begin, end in zip(begins, [*begins[1:], len(first)], strict=True):
        if end - begin < 4:
            raise LogError(f"{text.path}:{begin + 1}: the file ends in this step: it has no names and units")
        if _VARIABLES in first[begin:end]:
            yield _lims_step(text, first, begin, end, shear)
            continue
        title, names, units = (text.lines[begin + k] for k in (1, 2, 3))
        rows = tuple(line for line in text.lines[begin + 4 : end] if any(line.cells))
        yield TableBlock(TRIOS, title.cell(0), names.cells, names.number, _padded(units, names), rows, shear)


def _lims_step(text: InstrumentText, first: Sequence[str], begin: int, end: int, shear: bool | None) -> TableBlock:
    """Return a step whose lines say what they are: step name, number of points, variables, units, data points."""
    at = {first[k]: text.lines[k] for k in range(begin + 1, end) if first[k] != _POINT}
    names, units = at[_VARIABLES], at.get("units", TextLine(0, ()))
    rows = tuple(text.lines[k] for k in range(begin, end) if first[k] == _POINT)
    if _POINTS in at:
        _demand_all_rows(text, at[_POINTS], at[_POINTS].cell(1), rows)
    title = at["step name"].cell(1) if "step name" in at else ""
    return TableBlock(TRIOS, title, ("", *names.cells[1:]), names.number, _padded(units, names), rows, shear)


def _signals(text: InstrumentText, first: Sequence[str]) -> Iterator[TableBlock]:
    """One table of a Q800 and its like: lines ``Sig1``, ... name the columns, rows stand below StartOfData."""
    named = [(line, " ".join(line.cells)) for line in text.lines if _SIGNAL.match(line.cell(0).lower())]
    names = tuple(_SIGNAL.sub("", name.strip(), count=1).strip() for _, name in named)
    below = text.lines[first.index(_DATA) + 1 :]
    rows = (line for line in below if len([cell for cell in line.cells if cell]) >= len(names))
    about = " ".join(" ".join(line.cells) for line in text.lines[:_ABOUT])
    shear = True if _SHEAR.search(about) else False if _TENSILE.search(about) else None
    marks = tuple(line for line in rows if not line.cell(0).startswith("-"))  # negative times end a step
    yield TableBlock(SIGNALS, "", names, named[0][0].number, (), marks, shear)


def _rheocompass(text: InstrumentText, first: Sequence[str]) -> Iterator[TableBlock]:
    """Intervals: their number and length, ``Interval data:`` with names, units in brackets, and rows."""
    begins = [k for k, cell in enumerate(first) if cell == _INTERVAL]
    for begin, end in zip(begins, [*begins[1:], len(first)], strict=True):
        result = next((text.lines[k].cell(1) for k in range(begin, -1, -1) if first[k] == _RESULT), "")
        title = f"{result}, interval {text.lines[begin].cell(1)}".lstrip(", ")
        at = next((k for k in range(begin, end) if first[k] == _NAMES), None)
        if at is None:
            raise LogError(f"{text.path}:{begin + 1}: the interval has no line 'Interval data:' with names")
        names = text.lines[at]
        below = [line for line in text.lines[at + 1 : end] if any(line.cells)]
        units = below[0] if below and any(cell.startswith("[") for cell in below[0].cells) else None
        rest = below[1:] if units else below
        rows = tuple(line for line in rest if not line.cell(0) and any(line.cells))
        _demand_all_rows(text, text.lines[begin], text.lines[begin].cell(2), rows)
        stated = _padded(units, names) if units else ()
        yield TableBlock(RHEOCOMPASS, title, ("", *names.cells[1:]), names.number, stated, rows)


def _demand_all_rows(text: InstrumentText, head: TextLine, stated: str, rows: Sequence[TextLine]) -> None:
    """Raise LogError where a step or an interval has fewer rows than it says."""
    if stated.isdigit() and len(rows) < int(stated):
        raise LogError(f"{text.path}:{head.number}: states {stated} points, but has {len(rows)}: the file is cut short")


def _generic(text: InstrumentText) -> Iterator[TableBlock]:
    """Yield one table: names, perhaps units, and every line from the first row of numbers on."""
    begin = next((k for k, line in enumerate(text.lines) if any(line.cells) and text.is_row(line)), None)
    if begin is None:
        return
    rows = tuple(line for line in text.lines[begin:] if any(line.cells) and line.cell(0)[:1] not in tuple(_COMMENT))
    width = len(rows[0].cells)
    top = TopLines(text.path, text.raw[: begin + 1], RowBlock(begin, len(rows), width, width), text.dialect)
    names, at = top.names.cells, top.names.line
    if not names:
        names = tuple(f"column {k + 1}" for k in range(width))
    yield TableBlock(GENERIC, "", names, 0 if at is None else at + 1, tuple(map(plain_unit, top.unit_row.cells)), rows)


def _padded(units: TextLine, names: TextLine) -> tuple[str, ...]:
    return tuple(units.cell(k).strip("[]() ") for k in range(len(names.cells)))
