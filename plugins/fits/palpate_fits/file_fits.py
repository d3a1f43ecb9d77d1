"""Fits of files without a pipeline: one table with a verdict for each, and the pipeline that was used."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import typer
from palpate import ConfigurationError, printable, suggest
from palpate_engine import Pipeline, make_folder, option_of, registry, toml_tables
from palpate_kit.curves.alike_logs import LogPart, logs_among, specimens_of
from palpate_kit.curves.curve_fits import Row
from palpate_kit.curves.curve_list import RECORD, Entries, stated_in
from palpate_kit.curves.curve_pipelines import pipeline_counts
from palpate_kit.curves.curve_rows import CurveGroup, fit_rows, list_curves
from palpate_kit.curves.curve_table import TABLE, list_unread
from palpate_kit.curves.file_facts import FileFacts, file_facts
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.curves.shared_specimen import SetupPair, setup_pairs
from palpate_kit.curves.stated_facts import StatedFacts, keep_facts
from palpate_kit.jobs.portions import in_portions
from palpate_kit.terminal.fact_line import columns_line, fact_line
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.layout import print_line
from palpate_kit.terminal.motion_text import row_motion
from palpate_kit.terminal.prediction_text import BLOCK, HALF, prediction_text
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.result_screen import filled, title_line
from palpate_kit.terminal.table import console

from palpate_fits.fact_report import list_advice, report_listed, report_rig
from palpate_fits.file_pipelines import (
    DEVICE,
    FileGroup,
    FileGroups,
    FileReading,
    file_groups,
    reader_keys,
    with_overrides,
    worker_count,
)
from palpate_fits.file_questions import FileQuestion
from palpate_fits.file_tables import is_usable, law_line, partition_line, show_rows
from palpate_fits.fit_request import FitRequest
from palpate_fits.name_groups import group_table, groups_of
from palpate_fits.setup_tables import pairs_document, show_pairs
from palpate_fits.sitting import ask_of_files, ask_of_rig, is_asking, keep_answers, prompt

_GUESSES = 6  # that are printed (choice)
_DIALECTS = 6  # of which the columns are printed (choice)


@dataclass(frozen=True)
class SourceFiles:
    """The records among the sources, and where all of them are."""

    parts: Sequence[LogPart]
    folder: Path | None  # the one source that is a folder of files

    @property
    def by_name(self) -> dict[str, LogPart]:
        """The records by the names of their curves."""
        return {str(part): part for part in self.parts}


@dataclass(frozen=True)
class FittedFiles:
    """A folder of fits with the rows of the files that were asked for."""

    folder: FitFolder
    rows: Sequence[Row]  # of the files, those that could not be read among them
    groups: Sequence[FileGroup]
    named: Entries  # groups of curves of ``--by``

    @property
    def pairs(self) -> list[SetupPair]:
        """The pairs of tips or depths on one specimen."""
        return setup_pairs(self.folder, [row["curve"] for row in self.rows], registry.load())


def fit_files(request: FitRequest, stated: StatedFacts) -> None:
    """Fit files that bring no pipeline, and print what was found of each; exit 1 where one was not usable."""
    with progress("look for files"):
        files = _source_files(request.sources, stated, request.curve, request.jobs)
    facts = file_facts(request.sources, [part.curve for part in files.parts], stated)
    # Groups of curves by `--by`; groups of files that are read alike.
    named = groups_of(files.parts, request.sources, request.by, facts.cells)
    groups, facts = _groups(files.parts, facts, request)
    if facts.stated.is_read:
        report_rig([facts.stated.path])
    # Notes and errors of reading come before any fit.
    for note in groups.notes:
        typer.echo(note, err=True)
    groups.demand_any()
    folder = _listed(request.out, files, groups, facts, named)
    if request.fitting:
        names = [str(part) for part in files.parts]
        fit_rows(folder, names, request.jobs, order=names)
    keep_facts(folder.path, facts.stated)
    if not request.fitting:
        for name, error in groups.refused.items():
            typer.echo(f"{name}: {error}", err=True)
        typer.echo(f"{groups.count} curves to fit: palpate fit {folder.path}")
        return
    # The rows of these files, as JSON or on the screen.
    fitted = _fitted_files(folder.path, files, groups, named)
    if request.as_json:
        table = {"table": str(folder.table), "files": fitted.rows}
        print_json({**table, "specimens": pairs_document(fitted.pairs)})
    else:
        _show(fitted, files, request, _command(request, facts.stated))
    if not all(map(is_usable, fitted.rows)):
        raise typer.Exit(1)


def _source_files(sources: Sequence[Path], stated: StatedFacts, curve: str | None, jobs: int | None) -> SourceFiles:
    """Return the records among the sources, or the one that is named; raises ConfigurationError without any.

    `stated` has the facts and settings that a person has stated, `curve` is the name of the one record.
    """
    part_registry = registry.load()
    logs = logs_among(sources, part_registry)
    work = partial(_records_of_logs, reader_keys(stated.settings))
    records = in_portions(work, logs, worker_count(len(logs), jobs), _whole_log)
    parts = [part for parts_of_log in records for part in parts_of_log]
    if curve is not None:
        names = [part.part for part in parts if part.part is not None]
        parts = [part for part in parts if part.part == curve]
        if not parts:
            available = f"{len(names)} curves, {names[0]} to {names[-1]}" if names else "one curve"
            raise ConfigurationError(f"--curve: no curve {curve!r}{suggest(curve, names)} (there is: {available})")
    is_folder = len(sources) == 1 and sources[0].is_dir() and sources[0] not in logs
    return SourceFiles(parts, sources[0].resolve() if is_folder else None)


def _records_of_logs(choices: Mapping[str, str], logs: Sequence[Path]) -> list[list[LogPart]]:
    """Return the records of each of some logs."""
    return [specimens_of(log, registry.load(), choices) for log in logs]


def _whole_log(log: Path) -> list[LogPart]:
    """Return a log that has killed its process as one record."""
    return [LogPart(log)]


def _groups(files: Sequence[LogPart], facts: FileFacts, request: FitRequest) -> tuple[FileGroups, FileFacts]:
    """Return the files by how they are read, and the facts; on a terminal with the answers to questions about them.

    `facts` has what is stated of all files and of each. An answer may raise another question, so that files are looked
    at until no question is new.
    """
    asking = is_asking() and not request.as_json
    answered: set[FileQuestion] = set()
    certain: dict[LogPart, FileReading] = {}
    while True:
        with progress("look at", "files", len(files)):
            groups = file_groups(files, facts, request.choices, certain, request.jobs)
        new = {file: question for file, question in groups.questions.items() if question not in answered}
        if not asking or not new:
            break
        answered |= {*new.values()}
        facts = replace(facts, stated=ask_of_files(facts.stated, new, prompt))
    if asking and groups.read:
        facts = replace(facts, stated=ask_of_rig(facts, groups.read, prompt))
        keep_answers(facts.stated)
        groups = replace(groups, read=[with_overrides(group, facts.stated.overrides) for group in groups.read])
    return groups, facts


def _listed(out: Path | None, files: SourceFiles, groups: FileGroups, facts: FileFacts, named: Entries) -> FitFolder:
    """Begin the folder of fits of files, or go on with it; report what ``curves.csv`` states of them."""
    cells: Entries = {}
    for group in groups.read:
        cells |= facts.listed(group.curves, toml_tables(group.text))
    report_listed(map(stated_in, cells.values()), groups.count)
    for name, of_name in named.items():
        cells.setdefault(name, {}).update(of_name)
    path = out or make_folder("fit", None, datetime.now(UTC).astimezone())
    placed = [CurveGroup(_in_folder(group.pipeline, files.folder), DEVICE, group.curves) for group in groups.read]
    return list_curves(path, placed, cells)


def _in_folder(pipeline: Pipeline, place: Path | None) -> Pipeline:
    """Return the pipeline with the folder of its curves, where all are of one."""
    return replace(pipeline, run=pipeline.run.model_copy(update={"curves": place}))


def _fitted_files(path: Path, files: SourceFiles, groups: FileGroups, named: Entries) -> FittedFiles:
    """Return the rows of the files in their order, after those that could not be read have theirs."""
    order = {name: place for place, name in enumerate(files.by_name)}
    list_unread(path / TABLE, groups.refused, list(order))
    folder = FitFolder(path)
    rows = [row for row in folder.cells if row["curve"] in order]
    rows += [{"curve": name, "error": error} for name, error in groups.refused.items()]
    rows.sort(key=lambda row: order[row["curve"]])
    return FittedFiles(folder, rows, groups.read, named)


def _command(request: FitRequest, stated: StatedFacts) -> str:
    """Return the command line that fits the same files with the same facts, but for its folder."""
    facts = stated.facts.model_dump(include=set(stated.of_options))
    arguments = ["palpate", "fit", *(_no_option(str(source)) for source in request.sources)]
    for key, text in facts.items():
        arguments += [option_of(key), str(text)]
    for role, text in request.choices.items():
        arguments += [f"--{role}", text]
    for text in stated.settings:
        arguments += ["--set", text]
    if request.by is not None:
        arguments += ["--by", request.by]
    if stated.is_named:
        arguments += ["--rig", str(stated.path)]
    return shlex.join(arguments)


def _show(fitted: FittedFiles, files: SourceFiles, request: FitRequest, command: str) -> None:
    """Print what was assumed, the rows, what is a guess, and commands that go on from here.

    `fitted` has the folder of fits and the rows of the files in it, `command` is the line that repeats these fits.
    """
    rows, folder, part_registry = fitted.rows, fitted.folder, registry.load()
    pipeline = fitted.groups[0].pipeline
    kinds = pipeline_counts(folder, (row["curve"] for row in rows if not row.get("error")))
    # What was fitted, and what was assumed of it.
    print_line(title_line(rows[0]["curve"] if len(rows) == 1 else f"{len(rows)} files"))
    facts = fact_line(kinds or [(pipeline, len(rows))], [row_motion(row) for row in rows])
    for line in (*filled(facts), *_columns_lines(fitted.groups)):
        print_line(line)
    show_rows(
        rows,
        pipeline,
        parts=part_registry,
        command=command,
        details=request.details,
        advice=_advice(request.sources, len(rows)),
    )
    # Other laws for a single file, what is a guess, and commands that go on from here.
    if len(rows) == 1:
        for line in _law_lines(fitted):
            print_line(line)
    _show_guesses(fitted.groups, request.details)
    for line in _page_lines(fitted, files):
        print_line(line)
    # Groups and pairs of files, and how many have which verdict.
    if fitted.named:
        console().print(group_table(rows, fitted.named, pipeline).view())
    show_pairs(fitted.pairs)
    print_line(partition_line(rows, pipeline, part_registry))
    print_line(f"every number: {folder.table}; {SETTINGS} next to it: how the files were read")


def _advice(sources: Sequence[Path], count: int) -> dict[str, list[str]]:
    """Return where a fact can be stated for each of several files, by its option."""
    return list_advice(sources[0] if sources[0].is_dir() else sources[0].parent) if count > 1 else {}


def _law_lines(fitted: FittedFiles) -> Iterator[str]:
    """Yield what compares laws of one record, and how well the record predicts itself."""
    (row,) = fitted.rows
    pipeline, laws = fitted.groups[0].pipeline, row.get("better_laws", "").split()
    if line := law_line(fitted.folder.path, pipeline.tracks[0], registry.load(), laws):
        yield line
    if row.get("prediction"):
        yield prediction_text(float(row["prediction"]), HALF if row.get("frequency") else BLOCK)


def _page_lines(fitted: FittedFiles, files: SourceFiles) -> Iterator[str]:
    """Yield the command that makes a page on the first usable curve; nothing without one."""
    first = next((row["curve"] for row in fitted.rows if is_usable(row)), None)
    if first is None:
        return
    page, part = fitted.folder.path / "page", files.by_name[first]
    arguments = ["palpate", "fit", _no_option(str(part.path)), "--pipeline", str(fitted.folder.path / SETTINGS)]
    if part.part is not None:
        arguments += ["--set", f"device.{DEVICE}.{RECORD}={json.dumps(part.part)}"]
    arguments += ["-o", str(page)]
    report = shlex.join(["palpate", "report", str(page / part.path.name.split(".")[0])])
    yield f"{'a page' if len(fitted.rows) == 1 else 'a page on one'}: {shlex.join(arguments)} && {report}"


def _columns_lines(groups: Sequence[FileGroup]) -> list[str]:
    """Return which columns are taken, with the number of files where these differ."""
    counts = Counter[str]()
    for group in groups:
        counts[columns_line(group.pipeline)] += len(group.curves)
    lines = [(line, count) for line, count in counts.items() if line]
    return [f"{line} [{count} of {counts.total()}]" if len(counts) > 1 else line for line, count in lines[:_DIALECTS]]


def _no_option(name: str) -> str:
    """Return the name of a file so that it cannot be taken for an option."""
    return f"./{name}" if name.startswith("-") else name


def _show_guesses(groups: Sequence[FileGroup], details: bool) -> None:
    """Print the guesses that no file states, of the first groups of files."""
    guesses = [doubt for group in groups for doubt in group.doubts]
    shown = guesses if details else guesses[:_GUESSES]
    for doubt in shown:
        typer.echo(f"check {printable(doubt)}", err=True)
    if more := len(guesses) - len(shown):
        typer.echo(f"{more} more {'guess' if more == 1 else 'guesses'}: --details shows all", err=True)
