"""``palpate report``: a run, or many of them, as one page to share."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer
from palpate import ConfigurationError, OutputError, suggest
from palpate_engine import RIG, write_whole
from palpate_kit.curves.fit_folder import is_fit_folder
from palpate_kit.runs.run_groups import groups_of
from palpate_kit.terminal.options import UnitOption, WhereOption
from palpate_kit.terminal.progress import progress

from palpate_report.run_contents import RunContents

if TYPE_CHECKING:
    from palpate_report.folder_facts import FolderFacts

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
_TIMEOUT = 120.0  # [s] of a browser that prints: a choice
_MAX_ERROR_TEXT = 300  # characters of the end of its messages, in an error: a choice
_PAGES = (".html", ".htm")


def report(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RUN...",
            help="Run folders; several make a page that compares them, and so does a folder of fits of many curves.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None, typer.Option(metavar="NAME=PATTERN", help="A group of runs by a pattern; can be repeated.")
    ] = None,
    by: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Groups of curves by a column of curves.csv, such as sample.")
    ] = None,
    unit: UnitOption = None,
    where: WhereOption = None,
    track: Annotated[str | None, typer.Option(help="Track to show first, such as dr/fit. [default: the best]")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Page to write. [default: RUN/report.html, or comparison.html]")
    ] = None,
    methods: Annotated[
        bool, typer.Option("--methods", help="Of a folder of fits: a methods section, as text, LaTeX and BibTeX.")
    ] = False,
    supplement: Annotated[
        Path | None,
        typer.Option(metavar="TABLE", help="Of a folder of fits: a table of all curves, .csv, .tex or .xlsx."),
    ] = None,
    anonymous: Annotated[bool, typer.Option("--anonymous", help="Leave out the host and every path.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Print it to a PDF, too; needs Chromium or Chrome.")] = False,
) -> None:
    """Write one page on a run, or on many runs: verdict, numbers, flags, budget, pictures, pipeline."""
    if out is not None and out.suffix not in _PAGES:
        raise ConfigurationError(f"--out {out}: a page's name ends in {' or '.join(_PAGES)}")
    fit_folder = next((run for run in runs or () if is_fit_folder(run)), None)
    if fit_folder is None:
        options = {"--by": by, "--where": where, "--unit": unit, "--methods": methods, "--supplement": supplement}
        _refuse(options, "a folder of fits of many curves")
        text, path = _runs_page(groups_of(runs or [], group or []), track, anonymous)
        _hand_over(text, out or path, pdf)
        return
    # A folder of fits: texts for a paper, or its page.
    if len(runs or ()) > 1 or group:
        raise ConfigurationError(f"{fit_folder}: is a folder of fits of many curves, which is reported by itself")
    if unit and not by:
        raise ConfigurationError("--unit: is for groups, with --by COLUMN")
    if methods or supplement is not None:
        page_options = {"--out": out, "--pdf": pdf, "--anonymous": anonymous}
        _refuse(page_options, "the page, without --methods and --supplement")
        from palpate_report.curves_report import folder_facts

        _write_texts(folder_facts(fit_folder, track, by, where), methods, supplement, by, unit)
        return
    from palpate_report.curves_report import curves_page

    with progress(f"report of {fit_folder}"):
        text = curves_page(fit_folder, track, anonymous, by, where, unit)
        _hand_over(text, out or fit_folder / "report.html", pdf)


def _refuse(options: Mapping[str, object], purpose: str) -> None:
    """Raise ConfigurationError for the first option that is given, and is for another purpose."""
    for option, value in options.items():
        if value is not None and value is not False:
            raise ConfigurationError(f"{option}: is for {purpose}")


def _runs_page(groups: Mapping[str, Sequence[Path]], track: str | None, anonymous: bool) -> tuple[str, Path]:
    """Return the page on one run, or on several side by side, and its usual place."""
    from palpate_report.comparison_report import comparison_page

    paths = [path for members in groups.values() for path in members]
    with progress(f"report of {len(paths)} run{'s' * (len(paths) != 1)}"):
        if len(paths) == 1:
            record = RunContents.read(paths[0])
            return _page(record, track, anonymous), record.path / "report.html"
        return comparison_page(groups, track, anonymous), Path("comparison.html")


def _write_texts(facts: FolderFacts, methods: bool, supplement: Path | None, by: str | None, unit: str | None) -> None:
    """Write the methods section into the folder of fits, as text, LaTeX and BibTeX, and the table of the supplement.

    `by` and `unit` name the columns of groups and of units of replication.
    """
    if methods:
        from palpate_report.methods_text import UNSTATED, methods_text

        with progress("methods"):
            text = methods_text(facts, by, unit)
        for suffix, content in ((".txt", text.plain), (".tex", text.latex), (".bib", text.bibtex)):
            write_whole(facts.folder.path / f"methods{suffix}", content)
        typer.echo(text.plain, nl=False)
        if UNSTATED in text.plain:
            typer.echo(f'state it: instrument = "..." in {facts.folder.path / RIG}', err=True)
    if supplement is not None:
        from palpate_report.supplement import write_supplement

        write_supplement(facts, supplement)
        typer.echo(f"table: {supplement}")


def _hand_over(text: str, path: Path, pdf: bool) -> None:
    """Write a page, and print it to a PDF if requested, too."""

    write_whole(path, text)
    typer.echo(f"report: {path}")
    if pdf:
        print_pdf(path, path.with_suffix(".pdf"))
        typer.echo(f"report: {path.with_suffix('.pdf')}")


def write_report(folder: Path) -> Path:
    """Write ``report.html`` into a run folder, and return its path; raises UserError."""
    path = folder / "report.html"
    write_whole(path, _page(RunContents.read(folder), None, False))
    return path


def _page(record: RunContents, track: str | None, anonymous: bool) -> str:
    """Return the page on one run, `track` first; raises ConfigurationError if the run does not have it."""
    from palpate_report.run_report import page_of

    tracks = record.document.get("tracks", record.tracks)
    if track is not None and track not in tracks:
        raise ConfigurationError(f"{record.path}: has no track {track!r}{suggest(track, tracks)}")
    return page_of(record, track, anonymous)


def print_pdf(page: Path, target: Path) -> None:
    """Print a page to a PDF; raises ConfigurationError without Chromium or Chrome, OutputError where it fails."""
    browsers = filter(None, map(shutil.which, _BROWSERS))
    browser = next(browsers, None)
    if browser is None:
        raise ConfigurationError(
            f"--pdf: neither Chromium nor Chrome is on the PATH; open {page} in a browser and print it"
        )
    with TemporaryDirectory(prefix="palpate-print-") as folder:
        printed = Path(folder) / "report.pdf"
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--disable-extensions",
            "--no-first-run",
            "--no-pdf-header-footer",
        ]
        command += [f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}"]
        # Root has no sandbox; the page is our own, lets no script but ours run, and may load nothing.
        command += ["--no-sandbox"] if os.geteuid() == 0 else []
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, timeout=_TIMEOUT, check=False, text=True
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{target}: {browser} cannot print: {error}") from error
        if not printed.is_file():
            raise OutputError(f"{target}: {browser} printed nothing: {done.stderr.strip()[-_MAX_ERROR_TEXT:]}")
        try:
            shutil.copyfile(printed, target)
        except OSError as error:
            raise OutputError(f"{target}: cannot write: {error.strerror}") from error
