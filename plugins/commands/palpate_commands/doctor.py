"""``palpate doctor``: the examination of a rig at rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer
from palpate import UserError
from palpate_engine import load_pipeline, refuse_rehearsal
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption, Overrides

from palpate_commands.rig_examination import Finding, examine

_MARKS = {"good": "ok  ", "note": "note", "bad": "BAD "}
_MAX_LINES = 5  # findings that are not good (a choice: they fit a screen); the last line counts all


def doctor(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    overrides: Overrides = None,
    duration: Annotated[float, typer.Option(help="Listening time [s].", min=0.2)] = 2.0,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print everything that was looked at.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Connect every device and look: ports, rates, pauses, clocks, noise at rest, the limits. Nothing moves."""
    findings = []
    pipeline = load_pipeline(file, overrides or [])
    refuse_rehearsal(pipeline)
    for finding in examine(pipeline, duration):
        findings.append(finding)
        if verbose and not as_json:
            typer.echo(_line(finding))
    bad = sum(finding.verdict == "bad" for finding in findings)
    if as_json:
        print_json({"findings": findings, "bad": bad})
    elif not verbose:
        for line in _summary(findings):
            typer.echo(line)
    if bad:
        raise UserError(f"{bad} problem{'s' if bad > 1 else ''} to fix")


def _line(finding: Finding) -> str:
    return f"{_MARKS[finding.verdict]} {finding.subject}: {finding.text}"


def _summary(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the findings that are not good, the bad first, and the number of each verdict."""
    counts = Counter(finding.verdict for finding in findings)
    wrong = [finding for verdict in ("bad", "note") for finding in findings if finding.verdict == verdict]
    yield from map(_line, wrong[:_MAX_LINES])
    more = f", {len(wrong) - _MAX_LINES} of which are not above" if len(wrong) > _MAX_LINES else ""
    notes = f"{counts['note']} note{'s' if counts['note'] != 1 else ''}"
    yield f"{counts['good']} ok, {notes}, {counts['bad']} bad{more}; -v prints all"
