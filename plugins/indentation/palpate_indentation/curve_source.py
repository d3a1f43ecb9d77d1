"""Where a whole curve comes from: a pipeline file, a run folder, or a log that carries its pipeline."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer
from palpate import ConfigurationError, ContactModel, Floats, LogError, Samples, suggest
from palpate_engine import (
    AlignmentSettings,
    Pipeline,
    Source,
    build_parts,
    build_pipeline,
    is_live,
    run_pipeline,
    withdraw_folder,
)
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.progress import progress, report_progress

_SEGMENT = "segment"  # channel of a device that knows by itself which readings are on the way in
_OF_MATERIAL = ("model", "indenter")


@dataclass(frozen=True)
class WholeCurve:
    """A record before any estimate, and the contact model that its pipeline names."""

    name: str
    samples: Samples
    model: ContactModel
    model_name: str
    segment: Floats | None  # (n,) of the record's own segments; None where it has none
    alignment: AlignmentSettings
    uncertainties: Mapping[str, Any]  # that the pipeline declares
    place: Path
    changed: bool  # whether what was run is not what the place says of model and tip


def whole_record(place: Path, overrides: Sequence[str], model: str | None) -> WholeCurve:
    """Return the samples of a pipeline file, run folder or log, and one of its contact models; raises UserError."""
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
    samples = Samples.joined(kept.blocks)
    changed = any(assignment.partition(".")[0].strip() in _OF_MATERIAL for assignment in overrides)
    return WholeCurve(
        place.name, samples, models[model], model, _segments(pipeline, samples), pipeline.alignment,
        pipeline.run.uncertainties, place, changed,
    )  # fmt: skip


def _segments(pipeline: Pipeline, samples: Samples) -> Floats | None:
    """Segment (n,) of each sample, of a record whose stream of the position has a channel of that name."""
    signal = pipeline.alignment.position
    device, _, rest = signal.channel.partition(".")
    name = rest.rpartition(".")[0]
    stream = next((one for one in pipeline.devices[device].streams if one.name == name), None)
    columns = [channel.name for channel in stream.channels] if stream is not None else []
    if _SEGMENT not in columns:
        return None
    with pipeline.devices[device].connect(pipeline.run.seed) as link:
        batches = [batch for batch in link.batches() if batch.stream == name]
    time = np.concatenate([batch.time if signal.time == "stamp" else batch.received for batch in batches])
    values = np.concatenate([batch.values[:, columns.index(_SEGMENT)] for batch in batches])
    order = np.argsort(time, kind="stable")
    at = np.searchsorted(time[order] - round(signal.delay * 1e9), samples.stamp, side="right") - 1
    return np.asarray(values[order][np.maximum(at, 0)], np.float64)


def source_of(place: Path) -> Source:
    """Return the pipeline that reads a record, as a source to be built; raises LogError or ConfigurationError."""
    if not place.exists():
        raise LogError(f"{place}: no such file or folder")
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
