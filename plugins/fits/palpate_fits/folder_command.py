"""``palpate fit FOLDER``: settings of a folder of fits changed, and the curves that they concern fitted again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import typer
from palpate import ConfigurationError
from palpate_engine import (
    RIG,
    Pipeline,
    RigFacts,
    Source,
    build_pipeline,
    facts_left_open,
    facts_of,
    facts_stated,
    parsed_assignment,
    registry,
    resolved_text,
    start_tracks,
    tip_table,
)
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_fits import offline
from palpate_kit.curves.curve_list import FILE, LIST, add_groups, stated_in
from palpate_kit.curves.curve_pipelines import curve_reader, dialect_source
from palpate_kit.curves.curve_rows import demand_settings, fit_rows
from palpate_kit.curves.curve_table import columns_of_fits, list_unread, replace_columns
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS, write_dialects
from palpate_kit.curves.own_settings import change_assignments, write_own
from palpate_kit.curves.shared_specimen import setup_pairs
from palpate_kit.runs.replay_source import replace_model
from palpate_kit.runs.rig_file import write_rig
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.layout import print_line

from palpate_fits.fact_report import report_listed
from palpate_fits.file_questions import RATE
from palpate_fits.fit_request import FitRequest
from palpate_fits.folder_screen import show_folder
from palpate_fits.new_files import add_new_files
from palpate_fits.setup_tables import pairs_document

_NAMED = 6  # new files that are named (choice)


def fit_folder(path: Path, change: FitRequest) -> None:
    """Change settings of a folder of fits, and fit the curves that they concern; exit 1 where one was not usable.

    Raises ConfigurationError, LogError, OutputError.
    """
    if change.pipeline is not None or change.out is not None or change.by is not None:
        raise ConfigurationError(f"{path}: is a folder of fits, which has its pipeline; change it with --set")
    change = _with_rate(change, FitFolder(path))
    # New files in the folder of the curves come in first, then the settings change.
    added, refused = add_new_files(path) if change.where is None else ([], dict[str, str]())
    if added:
        more = ", ..." if len(added) > _NAMED else ""
        typer.echo(f"new in the folder of the curves: {', '.join(added[:_NAMED])}{more}", err=True)
    change_folder(path, change)
    folder = FitFolder(path)
    if change.where is None:
        _report_listed(folder, change.overrides)
    names = chosen_curves(folder, change.where)
    if not change.fitting:
        typer.echo(f"{stale_count(folder)} of {len(folder.names)} curves are to be fitted: palpate fit {path}")
        return
    # The curves without a row by the present settings are fitted.
    if not folder.curves():
        raise ConfigurationError(f"{path / LIST}: has no column {FILE!r}: the files of the curves are not known")
    demand_settings(folder, names)
    count = fit_rows(folder, names, change.jobs)
    _show(path, count, change, refused)


def _with_rate(change: FitRequest, folder: FitFolder) -> FitRequest:
    """Return the request with its rate as a setting of the device; raises ConfigurationError for a column."""
    columns = [role for role in change.choices if role != RATE]
    if columns:
        raise ConfigurationError(f"--{columns[0]}: {folder.path} has its columns; change them with --set")
    if RATE not in change.choices:
        return change
    device = curve_reader(folder, next(iter(folder.dialects))).device
    rate = f"device.{device}.rate={json.dumps(change.choices[RATE])}"
    return replace(change, overrides=(*change.overrides, rate))


def _report_listed(folder: FitFolder, overrides: Sequence[str]) -> None:
    """Report of how many curves ``curves.csv`` states a fact itself that is stated for all."""
    keys = {keys[1] for keys, _ in map(parsed_assignment, overrides) if keys[0] == "rig"}
    report_listed([stated_in(cells).keys() & keys for cells in folder.entries.values()], len(folder.names))


def _show(path: Path, count: int, change: FitRequest, refused: Mapping[str, str]) -> None:
    """Print the rows, and how many curves were fitted; exit 1 where one failed or could not be read.

    `refused` has the reasons why new files cannot be read, by name.
    """
    folder = FitFolder(path)
    if change.where is None:
        list_unread(folder.table, refused, [*folder.names, *refused])
    tracks = folder.summary
    pairs = setup_pairs(folder, folder.names, registry.load())
    if change.as_json:
        document = {"table": str(folder.table), "fitted": count, "tracks": tracks, "not_read": dict(refused)}
        print_json({**document, "specimens": pairs_document(pairs)})
    else:
        show_folder(folder, pairs, refused, change.details)
        print_line(f"{count} {'curve' if count == 1 else 'curves'} fitted again; every number: {folder.table}")
    if failed := sum(track["failed"] for track in tracks.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in tracks.values())} failed", err=True)
    if failed or refused:
        raise typer.Exit(1)


def chosen_curves(folder: FitFolder, where: str | None) -> list[str]:
    """Return the names of the curves that filter words hold; raises ConfigurationError if no curve matches."""
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    if not rows:
        raise ConfigurationError(f"--where {where!r}: holds of no curve" if where else f"{folder.path}: has no curves")
    return list(dict.fromkeys(row.curve for row in rows))


def stale_count(folder: FitFolder) -> int:
    """Return the number of curves without a row by the present settings."""
    return len({row.curve for row in folder.rows if row.state != "current"})


def change_folder(path: Path, change: FitRequest) -> None:
    """Write the settings of a change: of some curves into own.toml, of all into the pipeline of every dialect.

    A dialect is a way in which some of the folder's files are written, which has a pipeline of its own.
    Whatever is not a setting is refused before anything is written. Raises ConfigurationError, LogError, OutputError.
    """
    folder = FitFolder(path)
    names = chosen_curves(folder, change.where)
    if change.groups is not None:
        add_groups(path, change.groups, folder.names)
    if change.where is None:
        _change_all(folder, change)
        return
    if change.tip is not None or change.model is not None:
        option = "--tip" if change.tip is not None else "--model"
        raise ConfigurationError(f"{option}: is one for all curves of a folder; leave --where out, or use --set")
    if change.overrides or change.unset:
        assignments = dict(folder.own)
        for name in names:
            assignments[name] = change_assignments(folder.own.get(name, ()), change.overrides, change.unset)
        # Each dialect once for all curves with the same settings.
        for dialect, changed in {(folder.dialect_of(name), assignments[name]) for name in names}:
            _demand_fits(dialect_source(folder, dialect, changed))
        write_own(path, assignments)


@dataclass(frozen=True)
class _NewPipeline:
    """The pipeline of a dialect after a change."""

    text: str  # empty where it stays as it is
    columns: tuple[str, ...]  # of the table of its fits


def _change_all(folder: FitFolder, change: FitRequest) -> None:
    """Change the facts in ``rig.toml``, and the pipelines in what they state themselves."""
    if not (change.overrides or change.unset or change.tip or change.model):
        return
    answers = _answers(folder, change)
    stated = folder.facts.model_dump(exclude_defaults=True) | answers
    facts = facts_of({key: value for key, value in stated.items() if value is not None})
    pipelines = {name: _new_pipeline(folder, name, change, facts) for name in folder.dialects}
    if answers:
        write_rig(folder.path / RIG, answers)
    if texts := {name: pipeline.text for name, pipeline in pipelines.items() if pipeline.text}:
        write_dialects(folder.path / SETTINGS, texts)
    columns = list(pipelines.values())[-1].columns
    if folder.cells and tuple(folder.cells[0]) != columns:
        replace_columns(folder.table, columns)


def _new_pipeline(folder: FitFolder, dialect: str, change: FitRequest, facts: RigFacts) -> _NewPipeline:
    """Return the pipeline of a dialect with what it states itself changed.

    Raises ConfigurationError where nothing can be fitted by it, or by it with the `facts` of ``rig.toml``.
    """
    source = dialect_source(folder, dialect)
    if change.tip is not None:
        tip = tip_table(change.tip, registry.load(), "--tip")
        source.tables["indenter"] = dict.fromkeys(source.tables.get("indenter") or ["tip"], tip)
    if change.model is not None:
        replace_model(source, change.model)
    # A fact that the pipeline leaves open stays in rig.toml; whatever else is set stands in the pipeline.
    left_open = facts_left_open(source.tables, facts, registry.load())
    open_keys = {parsed_assignment(assignment)[0] for assignment in left_open}
    overrides = [text for text in change.overrides if parsed_assignment(text)[0] not in open_keys]
    for assignment in overrides:
        source.override(assignment)
    pipeline = _demand_fits(source)
    text = resolved_text(pipeline, folder.path) if overrides or change.tip or change.model else ""
    if left_open:
        _demand_fits(dialect_source(folder, dialect, left_open, text))
    return _NewPipeline(text, columns_of_fits(offline(pipeline)))


def _answers(folder: FitFolder, change: FitRequest) -> dict[str, Any]:
    """Return the facts of all curves that are stated, or taken back (None); raises ConfigurationError."""
    fact_keys = {*facts_stated().values()}
    stated = dict(map(parsed_assignment, change.overrides))
    answers = {keys[1]: value for keys, value in stated.items() if keys[0] == "rig" and keys[1] in fact_keys}
    for text in change.unset:
        table, _, key = text.partition(".")
        if table != "rig" or key not in fact_keys:
            raise ConfigurationError(
                f"--unset {text}: not a fact; a setting of single curves is taken back with --where"
            )
        if getattr(folder.facts, key) is None:
            raise ConfigurationError(f"--unset {text}: {folder.path / RIG} does not state it")
        answers[key] = None
    return answers


def _demand_fits(source: Source) -> Pipeline:
    """Return the pipeline whose fits can begin; raises ConfigurationError where they cannot."""
    pipeline = build_pipeline(source)
    for _ in start_tracks(offline(pipeline)):
        pass
    return pipeline
