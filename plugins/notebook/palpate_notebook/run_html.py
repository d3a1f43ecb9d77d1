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


def _cells(document: Document) -> tuple[list[str], list[list[str]]]:
    """Headings and a row for each track, each value with its verdict; the truth last where it is known."""
    tracks, truth = document["tracks"], document["truth"]
    table = document_table(document)
    units = {name: value.unit for row in table.rows for name, value in row.values.items()}
    headings = ["track", *(head for name, unit in units.items() for head in (f"{name} [{display_unit(unit)[0]}]", ""))]
    rows = []
    for row in table.rows:
        cells = [cell for name in units for cell in _pair(row.values.get(name))]
        track = tracks[row.track]
        surface = table_value("surface", track["surface"], track["verdict"]).number
        rows.append([row.track, *cells, surface, "" if track["nis"] is None else f"{track['nis']:.2f}"])
    if truth:
        known = [_truth(truth.get(name), unit) for name, unit in units.items()]
        surface = _truth(truth.get("surface"), "m")
        rows.append(["truth", *(cell for text in known for cell in (text, "")), surface, ""])
    return [*headings, f"surface [{display_unit('m')[0]}]", "NIS"], rows


def _pair(value: TableValue | None) -> tuple[str, str]:
    """Number and verdict; both empty for a value that a track lacks, and the first for one that must not be used."""
    if value is None:
        return "", ""
    return "" if value.verdict == "invalid" else value.number, value.word


def _truth(value: float | None, unit: str) -> str:
    return "" if value is None else round_number(value * display_unit(unit)[1])


def _lines(document: Document) -> list[str]:
    """Findings, notes and open facts."""
    table = document_table(document)
    return [in_python(printable(line)) for line in (*finding_lines(table), *fact_lines(table))]


def run_text(document: Document) -> str:
    """Return the table of tracks, findings, open facts and notes, for a terminal."""
    headings, rows = _cells(document)
    widths = [max(len(row[i]) for row in [headings, *rows]) for i in range(len(headings))]
    lines = [title_line(printable(document["run"]["name"]))]
    for row in [headings, *rows]:
        cells = (
            cell.ljust(width) if not i or not headings[i] else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  ".join(cells).rstrip())
    return "\n".join([*lines, *_lines(document)])


def run_html(document: Document) -> str:
    """Return the table of tracks, findings, open facts and notes, for a notebook; every text is escaped."""
    headings, rows = _cells(document)
    name, listed = escape(printable(document["run"]["name"])), escape("\n".join(_lines(document)))
    return f"<b>{name}</b> {LEGEND}{html_table(headings, rows)}{f'<pre>{listed}</pre>' if listed else ''}"
