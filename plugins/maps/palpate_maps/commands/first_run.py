"""The run or the folder of fits that a map is made of: it exists, or is made first from a pipeline or a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import tomli_w
import typer
from palpate import ConfigurationError, LogError, printable
from palpate_engine import Pipeline, Source, build_pipeline, load_pipeline, registry, run_pipeline, toml_tables
from palpate_kit.curves.stated_facts import StatedFacts, stated_facts, suggestion_by_facts
from palpate_kit.logs.draft_pipeline import pipeline_of
from palpate_kit.terminal.progress import progress, report_progress
from palpate_records.recording import Suggestion

from palpate_maps.commands.curve_map import fit_first, is_of_curves

_LATERAL = "lateral"  # the choice of the columns along the skin


def folder_of(
    source: Path, tip: str | None, model: str | None, choices: Mapping[str, str], overrides: Sequence[str]
) -> Path:
    """Return the folder of a run or of fits: `source` itself, or a new one where `source` has yet to be run or fitted.

    A pipeline file and a log of a sweep are run, curves are fitted. `choices` name the columns of a log by their roles,
    `overrides` are settings of the pipeline. Raises ConfigurationError for options of a run that has ended.
    """
    if is_of_curves(source, tip):
        pipeline = _sweep_pipeline(source.resolve(), stated_facts([source], overrides, tip=tip, model=model), choices)
        return fit_first(source, tip, model, choices, overrides) if pipeline is None else _run(pipeline, source)
    if choices:
        raise ConfigurationError(f"--{next(iter(choices))}: {source} says so itself; it is for logs without a pipeline")
    if source.suffix == ".toml":
        return _run(load_pipeline(source, [*overrides]), source)
    if overrides:
        raise ConfigurationError(f"{source}: has ended; `palpate replay` estimates it again with other facts")
    return source


def _run(pipeline: Pipeline, source: Path) -> Path:
    """Return the folder of a run that is made now."""
    with progress(str(source), "s"):
        outcome = run_pipeline(pipeline, None, report_progress)
    outcome.demand_whole()
    return outcome.folder


def _sweep_pipeline(log: Path, stated: StatedFacts, choices: Mapping[str, str]) -> Pipeline | None:
    """Return the pipeline of a table whose tip moves along the skin; None of any other log.

    It is suggested from the columns and the stated facts; `blanks` of the suggestion are what only a person can state.
    Raises ConfigurationError for what only a person can state, LogError for a column that does not move like one.
    """
    try:
        suggestion = suggestion_by_facts(log, stated.facts, choices, registry.load()) if log.is_file() else None
    except LogError:
        if _LATERAL in choices:
            raise
        return None  # the fit of its curves says why
    if suggestion is None or suggestion.sweep_speed is None:
        return None
    if stated.facts.tip is None:
        raise ConfigurationError(f'{log}: is a sweep along the skin: state its tip, as in --tip "sphere 3 mm"')
    if suggestion.blanks:
        raise ConfigurationError(f"{log}: {suggestion.blanks[0]}")
    for doubt in suggestion.doubts:
        typer.echo(f"check: {printable(doubt)}", err=True)
    source = Source(tomli_w.dumps(_tables(suggestion, log, stated.facts.model)), log.with_suffix(".toml"))
    for assignment in stated.overrides:
        source.override(assignment)
    return build_pipeline(source)


def _tables(suggestion: Suggestion, log: Path, model: str | None) -> dict[str, object]:
    """Return the tables of the suggested pipeline, with the model of a name where one is stated."""
    tables = toml_tables(pipeline_of(suggestion, log))
    if model is not None:
        parts = registry.load()
        name = parts.named("model", model)
        tip = {"indenter": "tip"} if "indenter" in parts.find("model", name).model_fields else {}
        tables["model"] = {name: {"type": name, **tip}}
    return tables
