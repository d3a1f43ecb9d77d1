"""``palpate fit choose``: which of several models the data support, over one or many records."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Floats, LogError, Problem, Samples, printable, suggest
from palpate_engine import Pipeline, Source, TrackResult, build_pipeline, display_unit, is_live, registry
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_pipelines import curve_source
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.logs.draft_pipeline import pipeline_of, suggestion_of
from palpate_kit.runs.replay_source import added_table, read_run_log, replay_source
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FormatOption, JsonOption, Overrides, WhereOption
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_uncertainty.held_out import held_out
from palpate_uncertainty.model_standings import Candidate, ModelStanding, rank_models, sentence

_FIT = "casadi-fit"
_MISFIT_FLAGS = ("lack-of-fit", "model-discrepancy")


def choose(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="Logs, run folders, pipeline files, or a folder of fits."),
    ],
    models: Annotated[
        str | None,
        typer.Option(help="Names or types of models, separated by commas. [default: all of the pipeline]"),
    ] = None,
    where: WhereOption = None,
    overrides: Overrides = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",  # set for all tables by the option's callback
) -> None:
    """Fit every model to every record, and report which of them the data support.

    By the evidence (BIC by independent samples), by blocks of each record held out of a fit, and by whether what
    is left is the channel's noise.
    """
    requested = [name.strip() for name in models.split(",") if name.strip()] if models else []
    fits = [candidate for run in runs for candidate in _of_source(run, requested, where, overrides or [])]
    standings = rank_models(fits)
    evidence = sentence(standings, len({fit.record for fit in fits}))
    if as_json:
        print_json({"standings": standings, "candidates": [_row(fit) for fit in fits], "sentence": evidence})
        return
    # The table, the sentence on all, and the doubts about single fits.
    console().print(_table(standings).view(), highlight=False)
    console().print(evidence, highlight=False)
    for fit in fits:
        if fit.doubts:
            text = f"{fit.record}, {fit.model}: {fit.verdict} ({', '.join(fit.doubts)})"
            console().print(text, style="yellow", markup=False, highlight=False)


def _of_source(
    path: Path, requested: Sequence[str], where: str | None, overrides: Sequence[str]
) -> Iterator[Candidate]:
    """Yield every model on a record, or on each curve of a folder of fits that is not rejected; raises UserError.

    `requested` are the names of the models, `where` is a condition on the curves, `overrides` change the pipeline.
    """
    if not is_fit_folder(path):
        if where is not None:
            raise ConfigurationError(f"--where: {path} is not a folder of fits of many curves")
        yield from candidates(path, _source(path, requested, overrides))
        return
    folder = FitFolder(path)
    chosen = {row.curve for row in curve_filter(where, folder).choose(folder.rows) if row.rejected is None}
    curves = [curve for curve in folder.curves() if curve.name in chosen]
    if not curves:
        raise ConfigurationError(
            f"{path}: has no curves{f' of {where!r}' if where else ''} that are not rejected and whose files are known"
        )
    for curve in curves:
        source = curve_source(folder, curve.name)
        for assignment in overrides:
            source.override(assignment)
        yield from candidates(Path(curve.name), with_candidates(source, path / SETTINGS, requested))


def candidates(path: Path, source: Source) -> list[Candidate]:
    """Return every model of a pipeline on one record, which messages call `path`; raises UserError."""
    from palpate_engine import run_pipeline

    pipeline = build_pipeline(source)
    if is_live(pipeline.devices):
        raise ConfigurationError(f"{path}: has a live device; record first: palpate run {path}")
    observer = SampleObserver()
    with tempfile.TemporaryDirectory() as folder, progress(str(path), "s"):
        result = run_pipeline(pipeline, Path(folder) / "run", report_progress, observer)
        result.demand_whole()
    if not observer.blocks:
        raise LogError(f"{path}: has no samples")
    samples = Samples.joined(observer.blocks)
    return [
        _candidate(str(path), str(track.name.model), result.tracks[str(track.name)], _blocks(pipeline, i, samples))
        for i, track in enumerate(pipeline.tracks)
    ]


def _blocks(pipeline: Pipeline, place: int, samples: Samples) -> Floats:
    """Return the errors (4,) [N] of a track's forecasts of blocks that are held out."""
    track, settings = pipeline.tracks[place], pipeline.alignment
    problem = Problem(track.model, settings.tip_mass, force_zero=settings.force_zero)
    return held_out(track.model, track.estimator, problem, samples)


def _candidate(record: str, model: str, track: TrackResult, blocks: Floats) -> Candidate:
    """Return one model on one record, by its track's result and the RMS errors of its held-out blocks (4,) [N].

    The elasticity is a parameter of the model, or derived from its parameters.
    """
    report, elasticity = track.report, track.parameters.get("elasticity")
    elasticity = elasticity or next((item.found for item in track.derived if item.name == "elasticity"), None)
    is_estimated = elasticity is not None and np.isfinite(elasticity.value)
    # The share of the samples that count as independent.
    bic, share = np.nan, 1.0
    if report is not None and report.bic is not None:
        bic, share = report.bic, min((report.effective_samples or report.samples) / max(report.samples, 1), 1.0)
    return Candidate(
        record=record,
        model=model,
        bic=float(bic),
        share=float(share),
        blocks=blocks,
        rms=report.rms if report else np.nan,
        misfit=any(flag.code in _MISFIT_FLAGS for flag in track.flags),
        verdict=track.verdict,
        elasticity=(float(elasticity.value), float(elasticity.combined)) if elasticity and is_estimated else None,
        doubts=tuple(dict.fromkeys(flag.code for flag in track.flags if flag.severity != "note")),
    )


def _source(path: Path, requested: Sequence[str], overrides: Sequence[str]) -> Source:
    """Return the pipeline of a record, by its file, its log, or a suggestion, with one fit of every candidate."""
    if path.suffix == ".toml":
        source = Source.read(path)
    elif (run_log := read_run_log(path)) is not None:
        source = replay_source(run_log)
    else:
        source = _suggested(path)
    for assignment in overrides:
        source.override(assignment)
    return with_candidates(source, path, requested)


def _suggested(log: Path) -> Source:
    """Return the suggested pipeline of a log that carries none; raises LogError where a blank must be filled in."""
    suggestion = suggestion_of(log, {})
    if missing := [*suggestion.blanks, *map(suggestion.rival_words, suggestion.rivals)]:
        remedy = f"palpate info {log} --suggest -o log.toml, then give log.toml"
        raise LogError(f"{log}: carries no pipeline, and {'; '.join(map(printable, missing))}: {remedy}")
    for text in suggestion.doubts:
        typer.echo(f"check: {printable(text)}", err=True)
    return Source(pipeline_of(suggestion, log), Path(f"{log.name}.toml"))


def with_candidates(source: Source, path: Path, requested: Sequence[str]) -> Source:
    """Return a pipeline with one fit of every candidate; raises ConfigurationError.

    `requested` are names or types of models, all of the pipeline's if it is empty; messages call the pipeline `path`.
    """
    tables = source.tables
    models: dict[str, Any] = tables.setdefault("model", {})
    requested = [name if name in models else registry.load().named("model", name) for name in requested]
    for name in requested:
        if name not in models:
            try:
                models[name] = added_table("model", name, tables)
            except ConfigurationError as error:
                raise ConfigurationError(f"--models: {name!r}: {error}{suggest(name, models)}") from error
    names = list(requested) or list(models)
    if len(names) < 2:
        raise ConfigurationError(f"{path}: has one model ({', '.join(names)}); name others with --models")
    # One fit for all of them: that of the pipeline, else one with its defaults.
    estimators = tables.setdefault("estimator", {})
    fit = next((name for name, table in estimators.items() if table.get("type") == _FIT), None)
    if fit is None:
        fit = _FIT
        estimators[fit] = {"type": _FIT}
    tables.setdefault("run", {})["tracks"] = [f"{name}/{fit}" for name in names]
    tables.pop("sink", None)  # the samples are recorded already
    return source


def _table(standings: Sequence[ModelStanding]) -> Table:
    """Return the table of models on the screen; "behind" is a BIC less that of the best model."""
    unit, factor = display_unit("Pa")
    rows = []
    for item in standings:
        elasticity = "-"
        if item.elasticity is not None:
            value, uncertainty = item.elasticity
            elasticity = value_with_uncertainty(factor * value, factor * uncertainty)
        cells = [
            item.model, f"{item.behind:.3g}", f"{100 * item.weight:.0f}", f"{item.held_out:.4f}",
            f"{item.best_blocks} of {item.blocks}", f"{item.misfits} of {item.records}", elasticity,
        ]  # fmt: skip
        rows.append(cells)
    headings = [
        "model", "BIC behind", "weight\n%", "held out\nN", "best in\nblocks", "lack of fit\nrecords",
        f"elasticity\n{unit}",
    ]  # fmt: skip
    return Table.of("models by the evidence of the data", headings, rows, ["model"])


def _row(candidate: Candidate) -> dict[str, Any]:
    """Return a candidate as in the JSON document."""
    return {
        "record": candidate.record, "model": candidate.model, "bic": candidate.bic, "independent": candidate.share,
        "held_out": candidate.blocks.tolist(), "rms": candidate.rms, "lack_of_fit": candidate.misfit,
        "verdict": candidate.verdict, "elasticity": candidate.elasticity, "doubts": list(candidate.doubts),
    }  # fmt: skip
