"""Fits of whole logs: a folder with a run for each, and fit.json."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import typer
from palpate import OutputError, PalpateError
from palpate_engine import (
    PIPELINE,
    Pipeline,
    bounded_text,
    finite_tree,
    json_document,
    make_folder,
    values_on_trust,
    withdraw_folder,
    write_whole,
)
from palpate_kit.jobs.engines import demand_scheduler
from palpate_kit.terminal.fact_line import fact_line
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.motion_text import motion_numbers
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.result_screen import filled, print_view, title_line
from palpate_kit.terminal.result_table import counted
from palpate_kit.terminal.stiffness_text import stiffness_lines
from palpate_kit.terminal.table import console

from palpate_fits.evaluation_tables import by_cycle, evaluation
from palpate_fits.file_tables import law_line
from palpate_fits.fit_jobs import LogFit, fits_of
from palpate_fits.fit_request import FitRequest
from palpate_fits.fit_sources import leave_out, named_pipelines
from palpate_fits.fit_tables import fit_overview, fit_views

_FIT = "fit.json"
_DETAILS_WIDTH = 160  # characters


def fit_logs(
    request: FitRequest,
    evaluated: Callable[[Sequence[LogFit]], list[dict[str, Any]]] = lambda _: [],
    cycles: Callable[[Sequence[LogFit]], list[dict[str, Any]]] = lambda _: [],
) -> None:
    """Fit logs, and print the fits, their evaluation on other logs, and their cycles; exit 1 where a log failed.

    `evaluated` and `cycles` make the rows of these two tables from the fitted logs; by default these stay empty.
    """
    demand_scheduler(request.scheduler, request.stage)
    failures: dict[str, PalpateError] = {}
    folder, logs = _fit_sources(request, failures)
    document = _document(logs, evaluated(logs), cycles(logs))
    _write(folder, document)
    if request.as_json:
        typer.echo(json.dumps(document, indent=2))
    else:
        _show(logs, document, folder, request.details)
    if failures:
        typer.echo(f"{len(failures)} of {len(request.sources)} logs failed: {', '.join(failures)}", err=True)
        raise typer.Exit(1)


def _fit_sources(request: FitRequest, failures: dict[str, PalpateError]) -> tuple[Path, list[LogFit]]:
    """Return the folder, and the fitted logs in the order of the sources; `failures` gets the errors of the others.

    ``fit.json`` is written after each log. Raises UserError where no log was fitted.
    """
    pipelines_by_name = _load_pipelines(request, failures)
    names = [name for name, _ in pipelines_by_name]
    continues = request.out is not None and (request.out / _FIT).is_file()
    folder = _folder(request.out, names)
    logs: list[LogFit] = []
    for name, outcome in fits_of(pipelines_by_name, folder, request.scheduler, request.stage, request.pictures):
        if isinstance(outcome, PalpateError):
            leave_out(name, outcome, failures)
            continue
        logs.append(outcome)
        logs.sort(key=lambda log: names.index(log.name))
        _write(folder, _document(logs, [], []))  # the logs so far
    if not logs:
        if not continues:
            withdraw_folder(folder)
        raise next(iter(failures.values()))
    return folder, logs


def _load_pipelines(request: FitRequest, failures: dict[str, PalpateError]) -> list[tuple[str, Pipeline]]:
    """Return name and pipeline of each source that can be read; with --details print what is assumed exact."""
    sources, reader = request.sources, request.pipeline
    # Workers stand elsewhere: for them all paths are absolute.
    if request.scheduler is not None:
        sources = tuple(source.resolve() for source in sources)
        reader = reader.resolve() if reader else None
    with progress(f"look at {len(sources)} sources"):
        pipelines_by_name = named_pipelines(sources, reader, list(request.overrides), failures)
    if request.details:
        for name, pipeline in pipelines_by_name:
            assumptions = ", ".join(f"{key} = {text}" for key, text in values_on_trust(pipeline).items())
            typer.echo(f"{name}: assumed exact: {assumptions}", err=True)
    return pipelines_by_name


def _folder(out: Path | None, names: Sequence[str]) -> Path:
    """Return a new folder, or one that holds fits of none but these logs; raises OutputError."""
    if out is None or not (out / _FIT).is_file():
        folder = make_folder("fit", out, datetime.now(UTC).astimezone())
        _write(folder, _document([], [], []))
        return folder
    try:
        fitted_names = list(json_document(bounded_text(out / _FIT))["logs"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{out / _FIT}: is not a document of palpate fit: {error}") from error
    if foreign := [name for name in fitted_names if name not in names]:
        raise OutputError(f"{out}: holds fits of {', '.join(foreign)}, which is not among these; nothing is mixed")
    return out


def _show(logs: Sequence[LogFit], document: dict[str, Any], folder: Path, details: bool) -> None:
    """Print the fits: the facts, the values with their verdicts, with `details` all numbers.

    `document` is that of ``fit.json`` in the folder, with the rows of the evaluation on other logs and of single
    cycles.
    """
    terminal = console(_DETAILS_WIDTH) if details else console()
    tables = {log.name: (log.result.tracks, log.result.flags) for log in logs}
    if layout() == "table":
        _print_text(title_line(logs[0].name if len(logs) == 1 else counted(len(logs), "log")))
        motions = [motion_numbers(table) for log in logs if (table := _motion(log))]
        _print_text("\n".join(filled(fact_line([(log.pipeline, 1) for log in logs], motions))))
    for view in fit_views(tables) if details else fit_overview(tables):
        print_view(terminal, view)
    if document["evaluation"]:
        terminal.print(evaluation(document["evaluation"]))
    if document["cycles"]:
        terminal.print(by_cycle(document["cycles"]))
    for log in logs if details else []:
        _print_text("\n".join(stiffness_lines(log.result)))
    _print_text(_law_words(logs))
    terminal.print(f"written to {folder}", highlight=False, markup=False, soft_wrap=True)


def _print_text(text: str) -> None:
    """Print a text as it is, without breaking its lines; nothing of an empty one."""
    if text:
        console().print(text, highlight=False, markup=False, soft_wrap=True)


def _motion(log: LogFit) -> Mapping[str, Any]:
    """Return the motion that the first track of a log measured; empty of one along the surface."""
    track = next(iter(log.result.tracks.values()), None)
    return {} if track is None else track.diagnoses.get("motion", {})


def _law_words(logs: Sequence[LogFit]) -> str:
    """Return the command that compares laws, of one fit of one log whose misfit is the material's; else nothing."""
    if len(logs) != 1 or len(logs[0].pipeline.tracks) != 1:
        return ""
    (log,), (track,) = logs, logs[0].pipeline.tracks
    misfit = log.result.tracks[str(track.name)].diagnoses.get("model-discrepancy", {})
    source = Path(str(log.result.folder)) / PIPELINE
    return law_line(source, track, log.pipeline.registry, misfit.get("better_laws", ()))


def _write(folder: Path, document: dict[str, Any]) -> None:
    """Write ``fit.json``."""
    write_whole(folder / _FIT, json.dumps(document, indent=2, allow_nan=False) + "\n")


def _document(logs: Sequence[LogFit], crossed: list[dict[str, Any]], cycles: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the contents of ``fit.json``."""
    tables = {log.name: {"folder": str(log.result.folder), **log.result.table()} for log in logs}
    document: dict[str, Any] = finite_tree({"logs": tables, "evaluation": crossed, "cycles": cycles})
    return document
