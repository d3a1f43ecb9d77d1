"""Fits of files without a pipeline: one table with a verdict for each, and the pipeline that was used."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import typer
from palpate import ConfigurationError, printable
from palpate_engine import Pipeline, Registry, approved_plugins, make_folder, option_of, registry, toml_tables
from palpate_kit.curves.alike_logs import LogPart, logs_among, specimens_of
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row
from palpate_kit.curves.curve_list import FACTS, LIST, RECORD, Entries, cells_beside, fact_counts, stated_in
from palpate_kit.curves.curve_table import SETTINGS, TABLE, FitTable
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.shared_specimen import setup_pairs
from palpate_kit.curves.stated_facts import StatedFacts, keep_facts
from palpate_kit.terminal.fact_line import columns_line, fact_line
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.motion_text import row_motion
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.result_screen import filled, title_line
from palpate_kit.terminal.table import console
from palpate_records.recording import Suggestion

from palpate_fits.file_pipelines import DEVICE, FileGroup, file_groups, reader_keys, with_overrides
from palpate_fits.file_questions import FileQuestion
from palpate_fits.file_tables import is_usable, law_line, partition_line, show_rows
from palpate_fits.folder_fits import FEW, fit_each
from palpate_fits.name_groups import group_table, groups_of
from palpate_fits.setup_tables import pairs_document, show_pairs
from palpate_fits.sitting import ask_of_files, ask_of_rig, is_asking, keep_answers, prompt

_GUESSES = 6  # that are printed
_DIALECTS = 6  # of which the columns are printed


@dataclass(frozen=True)
class FileFit:
    """What is asked of files that bring no pipeline."""

    stated: StatedFacts
    choices: Mapping[str, str]  # columns by role
    out: Path | None
    jobs: int | None
    as_json: bool
    fitting: bool = True
    details: bool = False
    by: str | None = None  # column of curves.csv, or pattern of names, by which they are grouped


def fit_files(sources: Sequence[Path], wanted: FileFit) -> None:
    """Fit files that bring no pipeline, and print what was found of each; exit 1 where one was not usable."""
    refused: dict[str, str] = {}
    notes: list[str] = []
    with progress("look for files"):
        known = registry.load()
        stated = reader_keys(wanted.stated.settings)
        logs = logs_among(sources, known)
        files = [part for log in logs for part in specimens_of(log, known, stated)]
    curves = [Curve(str(file), str(file.path.resolve()), record=file.part) for file in files]
    beside = cells_beside(sources, curves)
    by_name = groups_of(files, sources, wanted.by, beside)
    groups, wanted = _groups(files, wanted, refused, notes, beside)
    if wanted.stated.is_read:
        notes.insert(0, f"facts of the rig: {wanted.stated.path}")
    for note in notes:
        typer.echo(note, err=True)
    if not groups:
        name, error = next(iter(refused.items()))
        others = f" ({len(refused) - 1} more files cannot be read either)" if len(refused) > 1 else ""
        raise ConfigurationError(f"{name}: {error}{others}")
    folder = wanted.out or make_folder("fit", None, datetime.now(UTC).astimezone())
    place = sources[0].resolve() if len(sources) == 1 and sources[0].is_dir() and sources[0] not in logs else None
    groups = [replace(group, pipeline=_of_folder(group.pipeline, place)) for group in groups]
    cells = _listed(groups, beside, wanted.stated)
    for name, of_name in by_name.items():
        cells.setdefault(name, {}).update(of_name)
    order = {str(file): place for place, file in enumerate(files)}
    parts = {str(file): file for file in files}
    table = _fitted(groups, folder, wanted, cells)
    rows = [row for row in table.rows if row["curve"] in order]
    keep_facts(folder, wanted.stated)
    if not wanted.fitting:
        for name, error in refused.items():
            typer.echo(f"{name}: {error}", err=True)
        typer.echo(f"{sum(len(group.curves) for group in groups)} curves to fit: palpate fit {folder}")
        return
    table.list_unread(refused, list(order))
    rows += [{"curve": name, "error": error} for name, error in refused.items()]
    rows.sort(key=lambda row: order[row["curve"]])
    pairs = setup_pairs(FitFolder(folder), [row["curve"] for row in rows], known)
    if wanted.as_json:
        print_json({"table": str(folder / TABLE), "files": rows, "specimens": pairs_document(pairs)})
    else:
        _show(rows, groups, parts, folder, known, wanted, sources)
        if by_name:
            console().print(group_table(rows, by_name, groups[0].pipeline).view())
        show_pairs(pairs)
        typer.echo(partition_line(rows, groups[0].pipeline, known))
        typer.echo(f"every number: {folder / TABLE}; {SETTINGS} next to it: how the files were read")
    if not all(map(is_usable, rows)):
        raise typer.Exit(1)


def _of_folder(pipeline: Pipeline, place: Path | None) -> Pipeline:
    """The pipeline with the folder of its curves, where all are of one."""
    return replace(pipeline, run=pipeline.run.model_copy(update={"curves": place}))


def _groups(
    files: Sequence[LogPart],
    wanted: FileFit,
    refused: dict[str, str],
    notes: list[str],
    cells: Entries,
) -> tuple[list[FileGroup], FileFit]:
    """The files by how they are read; on a terminal with what was answered to all questions about them."""
    asking = is_asking() and not wanted.as_json
    seen: set[FileQuestion] = set()
    certain: dict[LogPart, Suggestion] = {}
    while True:
        refused.clear()
        notes.clear()
        questions: dict[str, FileQuestion] = {}
        with progress("look at", "files", len(files)):
            groups = list(file_groups(files, wanted.stated, wanted.choices, refused, notes, questions, certain, cells))
        new = {file: question for file, question in questions.items() if question not in seen}
        if not asking or not new:
            break
        seen |= {*new.values()}
        wanted = replace(wanted, stated=ask_of_files(wanted.stated, new, prompt))
    if asking and groups:
        wanted = replace(wanted, stated=ask_of_rig(wanted.stated, groups, cells, prompt))
        keep_answers(wanted.stated)
        groups = [with_overrides(group, wanted.stated.overrides) for group in groups]
    return groups, wanted


def _listed(groups: Sequence[FileGroup], cells: Entries, stated: StatedFacts) -> Entries:
    """Return the cells of ``curves.csv`` next to the files but for the facts that options state; report the facts."""
    listed = {
        curve.name: stated.without_options(cells[curve.name], toml_tables(group.text))
        for group in groups
        for curve in group.curves
        if curve.name in cells
    }
    if words := fact_counts(map(stated_in, listed.values()), sum(len(group.curves) for group in groups)):
        typer.echo(words, err=True)
    return listed


def _fitted(groups: Sequence[FileGroup], folder: Path, wanted: FileFit, cells: Entries) -> FitTable:
    """The table, with the rows of every group that had none yet added."""
    table: FitTable | None = None
    with progress("fit", "files", sum(len(group.curves) for group in groups)):
        done = 0
        for number, group in enumerate(groups, start=1):
            dialect = _dialect(number)
            reader = CurveReader(group.text, str(group.path), wanted.stated.overrides, DEVICE, approved_plugins())
            workers = wanted.jobs or (1 if len(group.curves) < FEW else None)
            table = fit_each(
                group.pipeline, reader, group.curves, folder, workers, dialect, wanted.fitting, cells=cells
            )
            done += len(group.curves)
            report_progress(done)
    assert table is not None
    return table


def _command(sources: Sequence[Path], wanted: FileFit) -> str:
    """The command line that fits the same files, but for its folder."""
    stated = wanted.stated
    facts = stated.facts.model_dump(include=set(stated.of_options))
    words = ["palpate", "fit", *(_no_option(str(source)) for source in sources)]
    words += [word for key, text in facts.items() for word in (option_of(key), str(text))]
    words += [word for role, text in wanted.choices.items() for word in (f"--{role}", text)]
    words += [word for text in stated.settings for word in ("--set", text)]
    words += ["--by", wanted.by] if wanted.by is not None else []
    words += ["--rig", str(stated.path)] if stated.is_named else []
    return shlex.join(words)


def _show(
    rows: Sequence[Row],
    groups: Sequence[FileGroup],
    parts: Mapping[str, LogPart],
    folder: Path,
    known: Registry,
    wanted: FileFit,
    sources: Sequence[Path],
) -> None:
    fitted = FitFolder(folder).pipelines(row["curve"] for row in rows if not row.get("error"))
    typer.echo(title_line(rows[0]["curve"] if len(rows) == 1 else f"{len(rows)} files"))
    facts = fact_line(fitted or [(groups[0].pipeline, len(rows))], [row_motion(row) for row in rows])
    for line in (*filled(facts), *_columns_lines(groups)):
        typer.echo(line)
    advice = _advice(sources, len(rows))
    show_rows(rows, groups[0].pipeline, known, _command(sources, wanted), wanted.details, advice)
    if len(rows) == 1:
        laws = rows[0].get("better_laws", "").split()
        if line := law_line(folder, groups[0].pipeline.tracks[0], known, laws):
            typer.echo(line)
        if rows[0].get("prediction"):
            typer.echo(f"every second block predicts the others within {float(rows[0]['prediction']):.1%} of the force")
    _show_guesses(groups, wanted.details)
    first = next((row["curve"] for row in rows if is_usable(row)), None)
    if first is not None:
        page = folder / "page"
        shown = parts[first]
        chosen = ["--set", f"device.{DEVICE}.{RECORD}={json.dumps(shown.part)}"] if shown.part is not None else []
        words = ["palpate", "fit", _no_option(str(shown.path)), "--pipeline", str(folder / SETTINGS)]
        words += [*chosen, "-o", str(page)]
        report = shlex.join(["palpate", "report", str(page / shown.path.name.split(".")[0])])
        typer.echo(f"a page on one: {shlex.join(words)} && {report}")


def _advice(sources: Sequence[Path], count: int) -> dict[str, list[str]]:
    """Return where a fact can be stated for each of several files, by its option."""
    if count < 2:
        return {}
    folder = sources[0] if sources[0].is_dir() else sources[0].parent
    by_column = {key: name for name, key in FACTS.items()}
    return {
        option_of(key): [f"or a column `{name}` in {folder / LIST}, a value for each file"]
        for key, name in by_column.items()
    }


def _columns_lines(groups: Sequence[FileGroup]) -> list[str]:
    """Return which columns are taken, with the number of files where these differ."""
    counts = Counter[str]()
    for group in groups:
        counts[columns_line(group.pipeline)] += len(group.curves)
    lines = [(line, count) for line, count in counts.items() if line]
    return [f"{line} [{count} of {counts.total()}]" if len(counts) > 1 else line for line, count in lines[:_DIALECTS]]


def _dialect(number: int) -> str:
    """What the dialect of a group is called, from 1: no number, which a program for tables would round."""
    return "" if number == 1 else f"d{number}"


def _no_option(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name


def _show_guesses(groups: Sequence[FileGroup], details: bool) -> None:
    """What no file states, for the first groups of files."""
    guesses = [doubt for group in groups for doubt in group.doubts]
    shown = guesses if details else guesses[:_GUESSES]
    for doubt in shown:
        typer.echo(f"check {printable(doubt)}", err=True)
    if more := len(guesses) - len(shown):
        typer.echo(f"{more} more {'guess' if more == 1 else 'guesses'}: --details shows all", err=True)
