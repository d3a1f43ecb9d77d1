"""The pages of a study, which other families make of a folder of fits, the same from the same files."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from palpate_engine import analysis
from palpate_kit.curves.fit_folder import FitFolder


def write_pages(fits: Path, options: Mapping[str, str]) -> list[str]:
    """Write report, methods, the table for the supplement and the figure of the groups into a folder of fits.

    Return the names of the files; raises UserError.
    """
    pages = ["report.html", "methods.txt", "methods.tex", "methods.bib", "supplement.csv", "supplement.tex"]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # what they print names a temporary folder
        report = analysis("report")
        report([fits], **options)
        report([fits], methods=True, **options)
        for suffix in (".csv", ".tex"):
            report([fits], supplement=fits / f"supplement{suffix}", **options)
        if "by" in options:
            parameter = FitFolder(fits).values[0]
            analysis("plot")(fits, parameter=parameter, format=["svg"], **options)
            pages += [f"pictures/{parameter}-groups{suffix}" for suffix in (".csv", ".svg")]
    return pages
