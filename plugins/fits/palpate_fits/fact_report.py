"""Lines on where the facts of files and curves are stated."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

import typer
from palpate_engine import option_of
from palpate_kit.curves.curve_list import FACTS, LIST, fact_counts


def report_rig(paths: Iterable[Path]) -> None:
    """Report the files that state facts of the rig, each once."""
    for path in dict.fromkeys(paths):
        typer.echo(f"facts of the rig: {path}", err=True)


def report_listed(facts: Iterable[Collection[str]], curves: int) -> None:
    """Report which of the `facts` of each curve ``curves.csv`` states, of so many curves."""
    if counts_text := fact_counts(facts, curves):
        typer.echo(counts_text, err=True)


def list_advice(folder: Path) -> dict[str, list[str]]:
    """Return where a fact can be stated for each of several files of a folder, by its option."""
    return {
        option_of(key): [f"or a column `{name}` in {folder / LIST}, a value for each file"]
        for name, key in FACTS.items()
    }
