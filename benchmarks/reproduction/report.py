"""What `reproduce.py` makes: palpate | paper | ratio, for every table and figure that contains a number."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate_engine import make_folder, write_new
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FolderOption, JsonOption
from palpate_kit.terminal.table import console

from reproduction import recordings as files
from reproduction.item import HERE, AuthorsRecording, Item, check_recordings, load_items, load_recordings
from reproduction.item_figure import draw
from reproduction.item_rows import Maker, Row
from reproduction.item_table import csv_text, latex_text, table_of, tally
from reproduction.reproduction_page import page

_SHOWN = {"row", "quantity", "unit", "spread", "source"}  # of what was published


def reproduce(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME...]", help="Tables and figures by label. [default: all]")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder with the authors' files, identified by their SHA-256, plain or gzipped.")
    ] = None,
    out: FolderOption = None,
    paper: Annotated[
        Path, typer.Option(help="Folder of another paper: items/*.toml, pipelines/, recordings.toml.")
    ] = HERE,
    strict: Annotated[bool, typer.Option("--strict", help="Also end with 1 where a recording is missing.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Reproduce the paper's tables and figures, and compare them with the published numbers.

    A number counts if it comes from a recording, lies within twice the combined uncertainty of both, and no constant
    was fitted to it. Fetches nothing: recordings that are not in the folder are named, with their source, and skipped.
    Ends with 1 where a number is outside its tolerance, or could not be made.
    """
    items, known = load_items(paper, names or ()), load_recordings(paper)
    check_recordings(items, known)
    asked = {row.recording for item in items for row in item.published if row.recording}
    asked |= {known[name].delay_of for name in asked} - {""}
    wanted = {name: recording for name, recording in known.items() if name in asked}
    found = files.find(data, known) if data is not None else {}
    folder = make_folder("reproduce", out, datetime.now(UTC).astimezone())
    maker = Maker(paper, folder / "runs", found, known)
    made: list[tuple[Item, list[Row]]] = []
    with print_aside(as_json):
        for item in items:
            rows = maker.rows(item)
            made.append((item, rows))
            _tell(item, rows)
            _write(folder, item, rows)
        write_new(folder / "index.html", page(made, known, found, maker.delays))
        lacking = {name: recording for name, recording in wanted.items() if name not in found}
        typer.echo(_summary(made, lacking))
        typer.echo(f"written to {folder}: index.html, and a CSV, LaTeX and picture of each")
    if as_json:
        print_json(
            {"folder": folder, "lacking": list(lacking), "items": {item.name: _rows(rows) for item, rows in made}}
        )
    statuses = [row.status for _, rows in made for row in rows]
    if {"outside", "failed"} & set(statuses) or (strict and "skipped" in statuses):
        raise typer.Exit(1)


def _tell(item: Item, rows: Sequence[Row]) -> None:
    table = table_of(item, rows)
    console(140).print(table.view() if rows else table.title, highlight=False, markup=False)
    for missing in item.missing:
        typer.echo(f"not possible from public data: {missing.what}: {missing.reason}")


def _rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    return [
        {
            **row.published.model_dump(mode="json", include=_SHOWN),
            "value": row.published.number,
            "tolerance": row.tolerance,
            "status": row.status,
            "found": row.value,
            "std": row.std,
            "ratio": row.ratio,
            "ratio_std": row.ratio_std,
            "said": row.said,
            "flags": row.flags,
        }
        for row in rows
    ]


def _write(folder: Path, item: Item, rows: Sequence[Row]) -> None:
    write_new(folder / f"{item.name}.csv", csv_text(item, rows))
    write_new(folder / f"{item.name}.tex", latex_text(item, rows))
    if any(row.ratio is not None for row in rows):
        draw(item, rows, folder / f"{item.name}.png")


def _summary(made: Sequence[tuple[Item, Sequence[Row]]], lacking: dict[str, AuthorsRecording]) -> str:
    lines = [tally(made)]
    if lacking:
        lines.append(f"{len(lacking)} recordings are not here ({', '.join(lacking)}); get them from")
        lines.append(files.how_to_get(lacking.values()))
        lines.append("and give their folder with --data")
    return "\n".join(lines)
