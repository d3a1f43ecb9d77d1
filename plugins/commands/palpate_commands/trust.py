"""``palpate trust``: approve the content of a plugin file, or list what is approved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import printable
from palpate_engine import trust_plugin, trusted_plugins


def trust(
    file: Annotated[
        Path | None, typer.Argument(help="A Python file that a recording names. [default: list all]")
    ] = None,
) -> None:
    """Approve a plugin file: wherever a log or a run folder names a file with this content, it may be executed.

    Prints its SHA-256 and path. Without a file, all approved contents are listed. A changed file is another content.
    """
    if file is not None:
        approved = trust_plugin(file)
        typer.echo(f"{approved.digest}  {printable(str(file.absolute()))}")
        return
    for digest, path in trusted_plugins().items():
        typer.echo(f"{digest}  {printable(path)}")
