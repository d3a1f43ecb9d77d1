"""A run as text and as HTML: values with their combined uncertainty and verdict, findings, open facts and notes."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from palpate import printable
from palpate_engine import display_unit
from palpate_kit.runs.document_table import document_table, table_value
from palpate_kit.terminal.quantities import round_number
from palpate_kit.terminal.result_screen import LEGEND, fact_lines, finding_lines, title_line
from palpate_kit.terminal.result_table import TableValue

from palpate_notebook.argument_names import in_python
from palpate_notebook.html_table import html_table

Document = Mapping[str, Any]


def _headings_and_rows(document: Document) -> tuple[list[str], list[list[str]]]:
    """Return the headings and a row for each track, each value with its verdict; the truth last if it is known.

    Columns: track, number and verdict of each value, surface, NIS.
    """
    table = document_table(document)
    units = {name: value.unit for row in table.rows for name, value in row.values.items()}
    headings = ["track"]
    for name, unit in units.items():
        headings += [f"{name} [{display_unit(unit)[0]}]", ""]
    headings += [f"surface [{display_unit('m')[0]}]", "NIS"]
    rows = []
    for row in table.rows:
        track = document["tracks"][row.track]
        cells = [row.track]
        for name in units:
            cells += _number_and_verdict(row.values.get(name))
        cells.append(table_value("surface", track["surface"], track["verdict"]).number)
        cells.append("" if track["nis"] is None else f"{track['nis']:.2f}")
        rows.append(cells)
    truth = document["truth"]
    if truth:
        cells = ["truth"]
        for name, unit in units.items():
            cells += [_true_number(truth.get(name), unit), ""]
        rows.append([*cells, _true_number(truth.get("surface"), "m"), ""])
    return headings, rows


def _number_and_verdict(value: TableValue | None) -> tuple[str, str]:
    """Return number and verdict of a value; no number if it is invalid, and neither for a value the track lacks."""
    if value is None:
        return "", ""
    return "" if value.verdict == "invalid" else value.number, value.word


def _true_number(value: float | None, unit: str) -> str:
    """Return a true value [SI] in display units; empty for None."""
    return "" if value is None else round_number(value * display_unit(unit)[1])


def _notes(document: Document) -> list[str]:
    """Return the lines of findings, notes and open facts."""
    table = document_table(document)
    return [in_python(printable(line)) for line in (*finding_lines(table), *fact_lines(table))]


def run_text(document: Document) -> str:
    """Return the table of tracks, findings, open facts and notes, for a terminal."""
    headings, rows = _headings_and_rows(document)
    widths = [max(len(row[column]) for row in [headings, *rows]) for column in range(len(headings))]
    lines = [title_line(printable(document["run"]["name"]))]
    for row in [headings, *rows]:
        cells = []
        for column, (cell, width) in enumerate(zip(row, widths, strict=True)):
            is_text = column == 0 or not headings[column]  # the track, or a verdict
            cells.append(cell.ljust(width) if is_text else cell.rjust(width))
        lines.append("  ".join(cells).rstrip())
    return "\n".join([*lines, *_notes(document)])


def run_html(document: Document) -> str:
    """Return the table of tracks, findings, open facts and notes, for a notebook; every text is escaped."""
    headings, rows = _headings_and_rows(document)
    name = escape(printable(document["run"]["name"]))
    notes = escape("\n".join(_notes(document)))
    return f"<b>{name}</b> {LEGEND}{html_table(headings, rows)}{f'<pre>{notes}</pre>' if notes else ''}"
