"""``palpate log export``: a log as a table, for spreadsheets and other programs, through files next to the result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, OutputError, printable
from palpate_kit.terminal.progress import progress
from palpate_records.temporary_folders import scratch

from palpate_logs.table_files import WRITERS
from palpate_logs.topic_arrays import topics_of

_MAX_NOTES = 20  # that are shown, a choice: a screen


def export(
    log: Annotated[Path, typer.Argument(help="The log: .mcap, .db3, a bag folder, .csv.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="x.csv, x.npz, x.mat or x.parquet; must not exist.")],
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Only this topic; can be repeated. [default: all]")
    ] = None,
) -> None:
    """Write numbers and texts of a log as one table (.csv, .parquet) or one array for each field (.npz, .mat)."""
    write = WRITERS.get(out.suffix)
    if write is None:
        raise ConfigurationError(f"--out {out}: the name must end in one of {', '.join(WRITERS)}")
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    notes: list[str] = []
    try:
        with scratch(out.parent) as folder, progress(f"export of {log.name}", "messages"):
            topic_files = topics_of(log, topics, folder, notes)
            changed_names = write(out, topic_files)
            # Of a topic with numbers and texts, the numbers count: their key is the last one in this order.
            counts = {topic_files[key].topic: len(topic_files[key]) for key in sorted(topic_files, reverse=True)}
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    for topic, name in changed_names.items():
        notes.append(f"topic {topic} is {name} in {out.name}: another one has its name there")
    shown_notes = notes[:_MAX_NOTES]
    if len(notes) > _MAX_NOTES:
        shown_notes.append(f"and {len(notes) - _MAX_NOTES} more")
    for note in shown_notes:
        typer.echo(f"{log}: {printable(note)}", err=True)
    typer.echo(f"{sum(counts.values())} messages of {len(counts)} topics are in {out}")
