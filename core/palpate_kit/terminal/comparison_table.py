"""The table that compares the tracks of one record: their values, then their measures, the same for all of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.result_screen import filled, value_table
from palpate_kit.terminal.result_table import (
    SYMBOLS,
    ResultRow,
    ResultTable,
    TrackMeasures,
    with_symbols,
)
from palpate_kit.terminal.table import Table

_MICROSECONDS = 1e6  # in a second
_MEASURE_COUNT, _WHOLE_MEASURE_COUNT = 4, 7  # columns of measures, of a terminal and of a whole table
_FIRST_WHOLE = 10  # from which on a number is shown without decimals: a choice
_REASON = "reason"
SLOW = "slower than real time"
_LEGEND = (
    "force %: error of the force predicted by the sample before; NIS > <: above, below its 95 % band; settled: to 5 % "
    "of the end; others: --format csv"
)


def comparison_table(table: ResultTable, is_whole: bool = False) -> Table:
    """Return a row for each track: E and eta with ± and verdict, prediction, NIS, time to settle, cost, distances.

    NIS is the normalised innovation squared, a distance the error over its uncertainty where the truth is known. On a
    terminal the reason of a track without numbers stands in their place, and a narrow one lacks the last columns. A
    table that `is_whole`, and any in a file, has all columns, every value, and the reasons in a column of their own.
    """
    is_whole |= layout() != "table"
    names = list(dict.fromkeys(name for row in table.rows for name in row.values)) if is_whole else table.names
    values = value_table(table, names=names)
    distant_names = [name for name in names if any(name in _distances(row) for row in table.rows)]
    # The cells of each track; a row of values without a track, the last, is the truth.
    rows: list[tuple[str, ...]] = []
    for value_cells, row in zip(values.rows, table.rows, strict=False):
        measure_cells = [*_measure_cells(row, is_whole), *_distance_cells(row, distant_names)]
        if is_whole:
            rows.append((*value_cells, *measure_cells, reason_of(row)))
        else:
            rows.append((*_with_reason(value_cells, row), *measure_cells))
    measure_headings = _measure_headings(distant_names, is_whole)
    if len(values.rows) > len(rows):
        rows.append((*values.rows[-1], *[""] * len(measure_headings)))
    headings, text_headings = values.headings, values.left
    if not is_whole:
        headings = tuple(map(with_symbols, headings))
        text_headings = tuple(map(with_symbols, text_headings))
    return replace(
        values,
        headings=(*headings, *measure_headings),
        rows=tuple(rows),
        left=(*text_headings, _REASON),
        spare=0 if is_whole else len(measure_headings),
    )


def _measure_headings(distant_names: Sequence[str], is_whole: bool) -> list[str]:
    """Return the headings of the measures, and of the distances of values from the truth."""
    if is_whole:
        headings = ["force\n%", "NIS", "NIS low", "NIS high", "settled\ns", "cost\nus", "samples"]
        return [*headings, *(f"{name} off [u]" for name in distant_names), _REASON]
    distances = (f"{SYMBOLS.get(name, name)} off\nu" for name in distant_names)
    return ["force\n%", "NIS", "settled\ns", "cost\nus", *distances]


def lines_below(table: ResultTable) -> Iterator[str]:
    """Yield the legend of the columns of measures, and a sentence on each track that is slower than its sensors."""
    yield from filled(_LEGEND, "  ")
    for row in table.rows:
        if row.measures is not None and row.measures.is_behind:
            cost = row.measures.seconds_per_sample * _MICROSECONDS
            yield from filled(f"{row.track} is {SLOW}: {cost:.0f} us a sample, on {row.measures.samples}", "  ")


def reason_of(row: ResultRow) -> str:
    """Return the flags by which values of a track are not good, and SLOW if it is slower than its sensors."""
    slow = [SLOW] if row.measures and row.measures.is_behind else []
    return ", ".join(dict.fromkeys((*(finding.code for finding in row.judging_findings), *slow)))


def _with_reason(cells: Sequence[str], row: ResultRow) -> list[str]:
    """Return the cells of a row; the flag that makes all of its values invalid stands in place of the first."""
    if not row.values or any(value.word != "invalid" for value in row.values.values()):
        return list(cells)
    reason = next((finding.code for finding in row.judging_findings if finding.word == "invalid"), cells[1])
    return [cells[0], reason.replace("-", " "), *cells[2:]]


def _measure_cells(row: ResultRow, is_whole: bool) -> list[str]:
    """Return prediction [%], NIS, time to settle of the first parameter [s] and cost of a sample [us]."""
    if (measures := row.measures) is None:
        return [""] * (_WHOLE_MEASURE_COUNT if is_whole else _MEASURE_COUNT)
    comparison = measures.comparison
    settled = next(iter(comparison.settling_times.values()), math.nan)
    cost = measures.seconds_per_sample * _MICROSECONDS if measures.samples else math.nan
    return [
        _number(100 * comparison.prediction),
        *_nis_cells(measures, is_whole),
        _number(settled),
        _number(cost),
        *([str(measures.samples)] if is_whole else []),
    ]


def _nis_cells(measures: TrackMeasures, is_whole: bool) -> list[str]:
    """Return the NIS with the bounds of its band, or with the bound that it is beyond."""
    low, high = measures.comparison.nis_band
    if is_whole:
        return [f"{number:.2f}" if math.isfinite(number) else "-" for number in (measures.nis, low, high)]
    if not math.isfinite(measures.nis):
        return ["-"]
    beyond = ">" if measures.nis > high else "<" if measures.nis < low else " "
    return [f"{measures.nis:.2f} {beyond}"]


def _distances(row: ResultRow) -> dict[str, float]:
    return dict(row.measures.comparison.distances) if row.measures else {}


def _distance_cells(row: ResultRow, names: Sequence[str]) -> list[str]:
    """Return the distances of values from the truth in combined uncertainties, with their signs."""
    distances = [_distances(row).get(name, math.nan) for name in names]
    return [f"{distance:+.1f}" if math.isfinite(distance) else "-" for distance in distances]


def _number(value: float) -> str:
    """Return a number with two digits, from 10 on as a whole number; a dash without one."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if value >= _FIRST_WHOLE else f"{value:.2g}"
