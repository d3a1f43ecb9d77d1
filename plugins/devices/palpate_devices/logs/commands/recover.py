"""``palpate recover``: the undamaged part of a damaged log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate.host import progress, recording_of


def recover(
    log: Annotated[Path, typer.Argument(help="The log that is cut or damaged.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The new log; must not exist.")],
) -> None:
    """Write the undamaged part of a log that is cut or damaged into a new one, and report what is missing."""
    with progress(f"recover {log.name}", "messages"):
        said = recording_of(log).recover(log, out)
    typer.echo(said)
