"""``palpate doctor``: is the rig well? Nothing moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import UserError
from palpate.host import load_pipeline
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption, Overrides

from palpate_commands.rig_examination import examine

_MARKS = {"good": "ok  ", "note": "note", "bad": "BAD "}


def doctor(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    overrides: Overrides = None,
    duration: Annotated[float, typer.Option(help="Listening time [s].", min=0.2)] = 2.0,
    as_json: JsonOption = False,
) -> None:
    """Connect every device and look: ports, rates, pauses, clocks, noise at rest, the limits. Nothing moves."""
    found = []
    for finding in examine(load_pipeline(file, overrides or []), duration):
        found.append(finding)
        if not as_json:
            typer.echo(f"{_MARKS[finding.verdict]} {finding.subject}: {finding.text}")
    bad = sum(finding.verdict == "bad" for finding in found)
    if as_json:
        print_json({"findings": found, "bad": bad})
    if bad:
        raise UserError(f"{bad} problem{'s' if bad > 1 else ''} to fix")
