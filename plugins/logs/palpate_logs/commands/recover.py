"""``palpate log recover``: the undamaged part of a damaged log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.progress import progress


def recover(
    log: Annotated[Path, typer.Argument(help="The log that is cut or damaged.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The new log; must not exist.")],
) -> None:
    """Write the undamaged part of a log that is cut or damaged into a new one, and report what is missing.

    The new log can be replayed: it keeps the pipeline of its run, or takes the one in the run folder next to it.
    """
    with progress(f"recover {log.name}", "messages"):
        report = recording_of(log).recover(log, out, RunFolder(log.parent).documents)
    typer.echo(report)
