"""Where a whole curve comes from: a pipeline file, a run folder, or a log that carries its pipeline."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import typer
from palpate import ConfigurationError, ContactModel, LogError, Samples
from palpate.host import Source, build_parts, build_pipeline, is_live, run_pipeline, suggest, withdraw_folder
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.progress import progress, report_progress


@dataclass(frozen=True)
class WholeCurve:
    """A record before any estimate, and the contact model that its pipeline names."""

    name: str
    samples: Samples
    model: ContactModel
    model_name: str
    tip_mass: float | None  # [kg]


def whole_record(place: Path, overrides: Sequence[str], model: str | None) -> WholeCurve:
    """The samples of a pipeline file, run folder or log, and one of its contact models; raises UserError."""
    source = source_of(place)
    for assignment in overrides:
        source.override(assignment)
    models: dict[str, ContactModel] = build_parts(source, "model")
    if model is None and len(models) == 1:
        model = next(iter(models))
    if model is None or model not in models:
        wanted = "choose a model with --model" if model is None else f"no [model.{model}]{suggest(model, models)}"
        raise ConfigurationError(f"{place}: {wanted} (there are: {', '.join(models) or 'none'})")
    pipeline = build_pipeline(source, estimates=False)
    if is_live(pipeline.devices):
        raise ConfigurationError(f"{place}: its devices are live; run it with a log, and give the run folder here")
    kept = SampleObserver()
    folder = Path(tempfile.mkdtemp(prefix="palpate-"))
    try:
        with progress(str(place), "s"):
            run_pipeline(pipeline, folder, report_progress, kept).demand_whole()
    finally:
        withdraw_folder(folder)
    if not kept.blocks:
        raise LogError(f"{place}: the record holds no samples")
    return WholeCurve(place.name, Samples.joined(kept.blocks), models[model], model, pipeline.alignment.tip_mass)


def source_of(place: Path) -> Source:
    """The pipeline that reads a record, as a source to be built; raises LogError or ConfigurationError."""
    if not place.exists():
        raise LogError(f"{place}: there is no such file or folder")
    if place.suffix == ".toml":
        return Source.read(place)
    if place.is_dir() and RunFolder(place).began:
        try:
            carried = read_run_log(place)
        except LogError:  # no log of its own: what it read may be one
            carried = None
        if carried is None:
            return Source.read(RunFolder(place).pipeline, named=False)
        return replay_source(carried)
    carried = read_run_log(place)
    if carried is None:
        raise ConfigurationError(
            f"{place}: carries no pipeline; `palpate info {place} --suggest -o pipeline.toml` writes one to start from"
        )
    typer.echo(f"{place}: tip, model and alignment are those of its run", err=True)
    return replay_source(carried)
