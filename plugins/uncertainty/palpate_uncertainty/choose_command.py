"""``palpate fit choose``: which of several models the data support, over one or many records."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Floats, LogError, Problem, Samples
from palpate.host import Pipeline, Source, TrackResult, build_pipeline, display_unit, is_live, suggest
from palpate_kit.runs.replay_source import added_table, read_run_log, replay_source
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FormatOption, JsonOption
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_uncertainty.held_out import held_out

_FIT = "casadi-fit"
_SUPPORTED = 6.0  # of BIC, by independent samples; strong evidence beyond (Kass and Raftery 1995)


@dataclass(frozen=True)
class Candidate:
    """One model on one record."""

    record: str
    model: str
    bic: float
    share: float  # of independent samples among those that were fitted
    blocks: Floats  # (4,) [N] held-out root mean squares
    rms: float  # [N] of the fit to all
    misfit: bool  # a lack of fit was found
    verdict: str
    elasticity: tuple[float, float] | None  # [Pa] and its combined uncertainty
    doubts: tuple[str, ...] = ()  # codes of the flags that speak against its numbers


@dataclass(frozen=True)
class ModelStanding:
    """One model over all records."""

    model: str
    behind: float  # of the best one's evidence
    weight: float
    held_out: float  # [N]
    best_blocks: int
    blocks: int
    misfits: int
    records: int
    elasticity: tuple[float, float] | None  # mean over records, and its uncertainty or spread, the larger


def choose(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders, logs of runs or pipeline files.")],
    models: Annotated[
        str | None,
        typer.Option(help="Names or types of models, separated by commas. [default: all of the pipeline]"),
    ] = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Fit every model to every record, and report which of them the data support.

    By the evidence (BIC by independent samples), by blocks of each record held out of a fit, and by whether what
    is left is the channel's noise.
    """
    wanted = [name.strip() for name in models.split(",") if name.strip()] if models else []
    found = [candidate for run in runs for candidate in candidates(run, wanted)]
    standings = rank_models(found)
    said = sentence(standings, len(runs))
    if as_json:
        print_json({"standings": standings, "candidates": [_row(one) for one in found], "sentence": said})
        return
    console().print(_table(standings).view(), highlight=False)
    console().print(said, highlight=False)
    for one in found:
        if one.doubts:
            text = f"{one.record}, {one.model}: {one.verdict} ({', '.join(one.doubts)})"
            console().print(text, style="yellow", markup=False, highlight=False)


def candidates(path: Path, wanted: Sequence[str]) -> list[Candidate]:
    """Every model on one record; raises UserError."""
    from palpate.host import run_pipeline

    pipeline = build_pipeline(_source(path, wanted))
    if is_live(pipeline.devices):
        raise ConfigurationError(f"{path}: has a live device; record first: palpate run {path}")
    kept = SampleObserver()
    with tempfile.TemporaryDirectory() as folder, progress(str(path), "s"):
        result = run_pipeline(pipeline, Path(folder) / "run", report_progress, kept)
        result.demand_whole()
    if not kept.blocks:
        raise LogError(f"{path}: has no samples")
    samples = Samples.joined(kept.blocks)
    return [
        _candidate(str(path), str(track.name.model), result.tracks[str(track.name)], _blocks(pipeline, i, samples))
        for i, track in enumerate(pipeline.tracks)
    ]


def _blocks(pipeline: Pipeline, place: int, samples: Samples) -> Floats:
    track, settings = pipeline.tracks[place], pipeline.alignment
    return held_out(track.model, track.estimator, Problem(track.model, settings.tip_mass), samples)


def _candidate(record: str, model: str, found: TrackResult, blocks: Floats) -> Candidate:
    report, value = found.report, found.parameters.get("elasticity")
    value = value or next((one.found for one in found.derived if one.name == "elasticity"), None)
    bic, share = np.nan, 1.0
    if report is not None and report.bic is not None:
        bic, share = report.bic, min((report.effective_samples or report.samples) / max(report.samples, 1), 1.0)
    return Candidate(
        record, model, float(bic), float(share), blocks, report.rms if report else np.nan,
        any(flag.code == "lack-of-fit" for flag in found.flags), found.verdict,
        (float(value.value), float(value.combined)) if value is not None and np.isfinite(value.value) else None,
        tuple(dict.fromkeys(flag.code for flag in found.flags if flag.severity != "note")),
    )  # fmt: skip


def _source(path: Path, wanted: Sequence[str]) -> Source:
    """The pipeline of a record with one fit of every candidate."""
    source = Source.read(path) if path.suffix == ".toml" else None
    if source is None:
        carried = read_run_log(path)
        if carried is None:
            raise LogError(f"{path}: carries no pipeline; give a pipeline file that reads it")
        source = replay_source(carried)
    tables = source.tables
    known: dict[str, Any] = tables.setdefault("model", {})
    for name in wanted:
        if name not in known:
            try:
                known[name] = added_table("model", name, tables)
            except ConfigurationError as error:
                raise ConfigurationError(f"--models: {name!r}: {error}{suggest(name, known)}") from error
    names = list(wanted) or list(known)
    if len(names) < 2:
        raise ConfigurationError(f"{path}: has one model ({', '.join(names)}); name others with --models")
    fits = tables.setdefault("estimator", {})
    own = next((name for name, table in fits.items() if table.get("type") == _FIT), None)
    if own is None:
        own = _FIT
        fits[own] = {"type": _FIT}
    tables.setdefault("run", {})["tracks"] = [f"{name}/{own}" for name in names]
    tables.pop("sink", None)
    return source


def rank_models(found: Sequence[Candidate]) -> list[ModelStanding]:
    """Models over all records, the best first; only those that have a fit of every record stand."""
    records = list(dict.fromkeys(one.record for one in found))
    names = list(dict.fromkeys(one.model for one in found))
    by = {(one.record, one.model): one for one in found}
    total = dict.fromkeys(names, 0.0)
    for record in records:
        for name, behind in _behind([one for one in found if one.record == record]).items():
            total[name] += behind
    finite = [value for value in total.values() if np.isfinite(value)]
    best = min(finite, default=0.0)
    shares = {name: float(np.exp(-(value - best) / 2)) if np.isfinite(value) else 0.0 for name, value in total.items()}
    winners = [_winner([by[record, name] for name in names if (record, name) in by]) for record in records]
    standings = []
    for name in names:
        own = [by[record, name] for record in records if (record, name) in by]
        blocks = np.concatenate([one.blocks for one in own]) if own else np.zeros(0)
        standings.append(
            ModelStanding(
                name, float(total[name] - best), shares[name] / max(sum(shares.values()), 1e-300),
                float(np.sqrt(np.mean(blocks**2))) if len(blocks) else float("nan"),
                sum(sum(winner == name for winner in record) for record in winners), sum(map(len, winners)),
                sum(one.misfit or one.verdict == "invalid" for one in own), len(records), _mean(own),
            )
        )  # fmt: skip
    return sorted(standings, key=lambda one: one.behind if np.isfinite(one.behind) else np.inf)


def _behind(group: Sequence[Candidate]) -> dict[str, float]:
    """How far each model's BIC is behind the best one's on a record, by samples that are independent under that.

    Sources: Kass and Raftery 1995; residuals that are correlated feign no certainty.
    """
    best = min((one for one in group if np.isfinite(one.bic)), key=lambda one: one.bic, default=None)
    if best is None:
        return {one.model: float("nan") for one in group}
    return {one.model: best.share * (one.bic - best.bic) for one in group}


def _winner(group: Sequence[Candidate]) -> list[str]:
    """Which model predicts each block of a record best."""
    if not group or not len(group[0].blocks):
        return []
    table = np.array([np.where(np.isfinite(one.blocks), one.blocks, np.inf) for one in group])
    return [group[int(place)].model for place in np.argmin(table, axis=0)]


def _mean(own: Sequence[Candidate]) -> tuple[float, float] | None:
    values = np.array([one.elasticity for one in own if one.elasticity is not None])
    if not len(values):
        return None
    spread = float(np.std(values[:, 0], ddof=1)) if len(values) > 1 else 0.0
    return float(values[:, 0].mean()), max(float(np.sqrt(np.mean(values[:, 1] ** 2))), spread)


def sentence(standings: Sequence[ModelStanding], records: int) -> str:
    """The data's evidence, in a sentence for a paper."""
    over = f"over {records} records" if records > 1 else "of the record"
    fair = [one for one in standings if one.misfits < one.records and np.isfinite(one.behind)]
    if not fair:
        return f"None of the models describes the data {over}: the residual of each is not the channel's noise."
    best = standings[0]
    level = [one.model for one in standings if one.behind < _SUPPORTED]
    refuted = [f"{one.model} by {one.behind:.3g}" for one in standings if one.behind >= _SUPPORTED]
    text = f"The data {over} support {' and '.join(level)}"
    text += " alike" if len(level) > 1 else f" (weight {100 * best.weight:.0f} %)"
    text += f"; less {', '.join(refuted)} of BIC" if refuted else ""
    if best.blocks:
        text += f"; {best.model} predicts {best.best_blocks} of {best.blocks} held-out blocks best"
    if best.misfits:
        text += f"; it leaves a lack of fit in {best.misfits} of {best.records}"
    return text + "."


def _table(standings: Sequence[ModelStanding]) -> Table:
    word, factor = display_unit("Pa")
    rows = [
        [
            one.model, f"{one.behind:.3g}", f"{100 * one.weight:.0f}", f"{one.held_out:.4f}",
            f"{one.best_blocks} of {one.blocks}", f"{one.misfits} of {one.records}",
            "-" if one.elasticity is None else value_with_uncertainty(*(factor * value for value in one.elasticity)),
        ]
        for one in standings
    ]  # fmt: skip
    headings = [
        "model", "BIC behind", "weight\n%", "held out\nN", "best in\nblocks", "lack of fit\nrecords",
        f"elasticity\n{word}",
    ]  # fmt: skip
    return Table.of("models by the evidence of the data", headings, rows, ["model"])


def _row(one: Candidate) -> dict[str, Any]:
    return {
        "record": one.record, "model": one.model, "bic": one.bic, "independent": one.share,
        "held_out": one.blocks.tolist(), "rms": one.rms, "lack_of_fit": one.misfit, "verdict": one.verdict,
        "elasticity": one.elasticity, "doubts": list(one.doubts),
    }  # fmt: skip
