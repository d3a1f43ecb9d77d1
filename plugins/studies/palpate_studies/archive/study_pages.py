"""The pages of a study: what other families make of a folder of fits, made again from the same files."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from palpate_engine import analysis

PAGES = ("report.html", "methods.txt", "methods.tex", "methods.bib", "supplement.csv", "supplement.tex")


def write_pages(fits: Path, options: Mapping[str, str]) -> None:
    """Write report, methods and the table for the supplement into a folder of fits; raises UserError."""
    with redirect_stdout(StringIO()):
        report = analysis("report")
        report([fits], **options)
        report([fits], methods=True, **options)
        for suffix in (".csv", ".tex"):
            report([fits], supplement=fits / f"supplement{suffix}", **options)
