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
_HEADER_LINES = 40  # that may name the instrument, a choice
_STEP_LINES = 4  # of a step of TRIOS before its rows: [step], title, names, units
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
    shear: bool | None = None  # True for a rheometer, False for a DMA; None where the file does not name its instrument


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
    """Yield the steps of TRIOS, by the first cell of each line.

    A step is a line ``[step]``, its title, names, units, and rows up to an empty line; or the LIMS form of a step.
    """
    starts = [k for k, cell in enumerate(first) if cell == _STEP]
    instrument_lines = [line for line in text.lines[: starts[0]] if "nstrument" in line.cell(0)]
    shear = _shear_of(" ".join(" ".join(line.cells[:2]) for line in instrument_lines))
    for start, stop in zip(starts, [*starts[1:], len(first)], strict=True):
        if stop - start < _STEP_LINES:
            raise LogError(f"{text.path}:{start + 1}: the file ends in this step: it has no names and units")
        if _VARIABLES in first[start:stop]:
            yield _lims_step(text, first, start, stop, shear)
            continue
        title, names, units = text.lines[start + 1 : start + _STEP_LINES]
        rows = tuple(line for line in text.lines[start + _STEP_LINES : stop] if any(line.cells))
        yield TableBlock(TRIOS, title.cell(0), names.cells, names.number, _padded(units, names), rows, shear)


def _shear_of(instrument: str) -> bool | None:
    """Return True for the name of a rheometer, False for that of a DMA, None for any other text."""
    if _SHEAR.search(instrument):
        return True
    return False if _TENSILE.search(instrument) else None


def _lims_step(text: InstrumentText, first: Sequence[str], start: int, stop: int, shear: bool | None) -> TableBlock:
    """Return a step whose lines begin with their kind: step name, number of points, variables, units, data point."""
    line_of = {first[k]: text.lines[k] for k in range(start + 1, stop) if first[k] != _POINT}
    names, units = line_of[_VARIABLES], line_of.get("units", TextLine(0, ()))
    rows = tuple(text.lines[k] for k in range(start, stop) if first[k] == _POINT)
    if _POINTS in line_of:
        _demand_all_rows(text, line_of[_POINTS], line_of[_POINTS].cell(1), rows)
    title = line_of["step name"].cell(1) if "step name" in line_of else ""
    return TableBlock(TRIOS, title, ("", *names.cells[1:]), names.number, _padded(units, names), rows, shear)


def _signals(text: InstrumentText, first: Sequence[str]) -> Iterator[TableBlock]:
    """Yield the table of a Q800 and its like: lines ``Sig1``, ... name the columns, rows stand below StartOfData."""
    name_lines = [line for line in text.lines if _SIGNAL.match(line.cell(0).lower())]
    names = tuple(_SIGNAL.sub("", " ".join(line.cells).strip(), count=1).strip() for line in name_lines)
    shear = _shear_of(" ".join(" ".join(line.cells) for line in text.lines[:_HEADER_LINES]))
    rows = []
    for line in text.lines[first.index(_DATA) + 1 :]:
        is_full = len([cell for cell in line.cells if cell]) >= len(names)
        is_mark = line.cell(0).startswith("-")  # negative times end a step
        if is_full and not is_mark:
            rows.append(line)
    yield TableBlock(SIGNALS, "", names, name_lines[0].number, (), tuple(rows), shear)


def _rheocompass(text: InstrumentText, first: Sequence[str]) -> Iterator[TableBlock]:
    """Yield the intervals of RheoCompass.

    An interval is a line with its number and length, ``Interval data:`` with names, units in brackets, and rows.
    """
    starts = [k for k, cell in enumerate(first) if cell == _INTERVAL]
    for start, stop in zip(starts, [*starts[1:], len(first)], strict=True):
        # The nearest line above names the result that the interval belongs to.
        result = next((text.lines[k].cell(1) for k in range(start, -1, -1) if first[k] == _RESULT), "")
        title = f"{result}, interval {text.lines[start].cell(1)}".lstrip(", ")
        names_index = next((k for k in range(start, stop) if first[k] == _NAMES), None)
        if names_index is None:
            raise LogError(f"{text.path}:{start + 1}: the interval has no line 'Interval data:' with names")
        names = text.lines[names_index]
        lines = [line for line in text.lines[names_index + 1 : stop] if any(line.cells)]
        has_units = bool(lines) and any(cell.startswith("[") for cell in lines[0].cells)
        units = _padded(lines[0], names) if has_units else ()
        rows = tuple(line for line in (lines[1:] if has_units else lines) if not line.cell(0))
        _demand_all_rows(text, text.lines[start], text.lines[start].cell(2), rows)
        yield TableBlock(RHEOCOMPASS, title, ("", *names.cells[1:]), names.number, units, rows)


def _demand_all_rows(text: InstrumentText, heading: TextLine, stated: str, rows: Sequence[TextLine]) -> None:
    """Raise LogError where a step or an interval has fewer rows than its heading states."""
    if stated.isdigit() and len(rows) < int(stated):
        raise LogError(
            f"{text.path}:{heading.number}: states {stated} points, but has {len(rows)}: the file is cut short"
        )


def _generic(text: InstrumentText) -> Iterator[TableBlock]:
    """Yield one table: names, perhaps units, and every line from the first row of numbers on."""
    start = next((k for k, line in enumerate(text.lines) if any(line.cells) and text.is_row(line)), None)
    if start is None:
        return
    lines = [line for line in text.lines[start:] if any(line.cells)]
    rows = tuple(line for line in lines if line.cell(0)[:1] not in tuple(_COMMENT))
    width = len(rows[0].cells)
    row_block = RowBlock(start, len(rows), width, width)
    top = TopLines(text.path, text.raw[: start + 1], row_block, text.dialect)
    names = top.names.cells or tuple(f"column {k + 1}" for k in range(width))
    names_line = 0 if top.names.line is None else top.names.line + 1  # counted from 1
    yield TableBlock(GENERIC, "", names, names_line, tuple(map(plain_unit, top.unit_row.cells)), rows)


def _padded(units: TextLine, names: TextLine) -> tuple[str, ...]:
    """Return a unit without brackets for each name, empty where there are fewer units."""
    return tuple(units.cell(k).strip("[]() ") for k in range(len(names.cells)))
