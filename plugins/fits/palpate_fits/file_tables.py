"""The screen of fits of many files: a row for each with its verdict, then the reasons of doubts."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import typer
from palpate_engine import Pipeline, Registry, Track
from palpate_kit.curves.curve_fits import Row, value_units
from palpate_kit.curves.row_results import row_table
from palpate_kit.curves.row_summary import summary_of
from palpate_kit.terminal.layout import layout, print_line
from palpate_kit.terminal.motion_text import measured_text, row_motion
from palpate_kit.terminal.result_screen import (
    WIDTH,
    coloured,
    fact_lines,
    filled,
    finding_lines,
    value_lines,
    value_table,
)  # fmt: skip
from palpate_kit.terminal.table import Table, console

from palpate_fits.quartile_table import each_table

_MEASURED = "measured"
MAX_ROWS = 40  # rows of a table on the terminal (choice)
_DETAILS_WIDTH = 160  # characters
_SHOWN = ("elasticity", "viscosity")
_DETAILS = {"rms": ("RMS\nN", ".3g"), "prediction": ("predicted\nwithin", ".1%"), "samples": ("samples", ".0f")}


def is_usable(row: Row) -> bool:
    """Return True if a row has values that are not refused, the first that is shown of them among these."""
    named = [key for key in row if key.endswith("_verdict")]
    first = next((key for name in _SHOWN if (key := f"{name}_verdict") in named), next(iter(named), "verdict"))
    return not row.get("error") and "invalid" not in (row.get("verdict"), row.get(first))


def show_rows(
    rows: Sequence[Row],
    pipeline: Pipeline,
    parts: Registry,
    command: str,
    details: bool = False,
    advice: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Print the values of each file, the errors of reading, the findings with their counts, and the open facts.

    `rows` has the values of each file by name, or the error of reading it; `parts` is the registry of parts, `advice`
    are more lines of help by the option of a remedy.
    """
    model = pipeline.tracks[0].model
    table = row_table(rows, model, parts)
    shown_rows = rows if details else rows[:MAX_ROWS]
    terminal = console(_DETAILS_WIDTH) if details else console(WIDTH)
    # Values: lines for a single file, else a table.
    if len(rows) == 1 and not details and layout() == "table" and not rows[0].get("error"):
        for value in value_lines(table.rows[0], {}):
            terminal.print(value)
    else:
        terminal.print(file_table(shown_rows, pipeline, parts, details).view())
    # Of more rows than are shown, a summary of all.
    if len(shown_rows) < len(rows):
        print_line(f"and {len(rows) - len(shown_rows)} more: --details shows all")
        rows_with_track = [row for row in rows if row.get("track")]
        console().print(each_table(summary_of(rows_with_track, list(value_units(model))), pipeline).view())
    _print_errors(rows)
    for line in (*finding_lines(table, command, advice), *fact_lines(table, command)):
        terminal.print(coloured(line), soft_wrap=True)


def _print_errors(rows: Sequence[Row]) -> None:
    """Print each error once, with the first file that has it and the number of the others."""
    names_by_error: dict[str, list[str]] = {}
    for row in rows:
        if row.get("error"):
            names_by_error.setdefault(row["error"], []).append(row["curve"])
    for error, names in names_by_error.items():
        more_files = f" and {len(names) - 1} more" if len(names) > 1 else ""
        typer.echo(f"{names[0]}{more_files}: {error}", err=True)


def law_line(source: Path, track: Track, parts: Registry, better_laws: Sequence[str]) -> str:
    """Return the command that compares a track's law with those that describe its record better; empty without any."""
    laws = [law for law in better_laws if law != parts.name_of(type(track.model))]
    if not laws:
        return ""
    models = ",".join([track.name.model, *laws])
    return f"a better law? {shlex.join(['palpate', 'fit', 'choose', str(source), '--models', models])}"


def partition_line(rows: Sequence[Row], pipeline: Pipeline, parts: Registry) -> str:
    """Return the number of files with each verdict, of each value."""
    table = row_table(rows, pipeline.tracks[0].model, parts)
    return "\n".join(filled(table.partition(), "  "))


def file_table(rows: Sequence[Row], pipeline: Pipeline, parts: Registry, details: bool = False) -> Table:
    """Return file, track where there are several, and each value with its verdict; with `details` all other columns."""
    values = value_table(row_table(rows, pipeline.tracks[0].model, parts), whole_names=details)
    if not details:
        return values
    heads = [head for head, _ in _DETAILS.values()]
    cells = [(*value_cells, *_detail_cells(row)) for row, value_cells in zip(rows, values.rows, strict=True)]
    return Table.of("", [*values.headings, *heads, _MEASURED, "flags"], cells, [*values.left, _MEASURED, "flags"])


def _detail_cells(row: Row) -> list[str]:
    """Return a row's numbers of `_DETAILS`, its motion in words, and its flags, each in a line."""
    cells = []
    for name, (_, number_format) in _DETAILS.items():
        cells.append(format(float(row[name]), number_format) if row.get(name) else "-")
    return [*cells, _lines(measured_text([row_motion(row)])), row.get("flags", "").replace(" ", "\n")]


def _lines(motion: str) -> str:
    """Return the parts of a motion below one another."""
    return motion.replace("; ", "\n").replace(", ", "\n")
