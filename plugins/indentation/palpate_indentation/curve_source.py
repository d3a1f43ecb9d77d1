"""The record of a whole curve, from a pipeline file, a run folder, or a log that carries its pipeline."""

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

_SEGMENT = "segment"  # channel of a device whose readings state by themselves which are on the way in
_MATERIAL_TABLES = ("model", "indenter")  # of a pipeline file
_NANOSECONDS = 1e9  # in a second, of time-stamps


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
    changed: bool  # True if the overrides change model or tip, so that they are not those of the place


def whole_record(place: Path, overrides: Sequence[str], model: str | None) -> WholeCurve:
    """Return the samples of a pipeline file, run folder or log, and one of its contact models; raises UserError."""
    source = source_of(place)
    for assignment in overrides:
        source.override(assignment)
    models: dict[str, ContactModel] = build_parts(source, "model")
    model_name = _model_name(models, model, place)
    pipeline = build_pipeline(source, estimates=False)
    if is_live(pipeline.devices):
        raise ConfigurationError(f"{place}: its devices are live; run it with a log, and give the run folder here")
    samples = _pipeline_samples(pipeline, place)
    changed_tables = [assignment.partition(".")[0].strip() for assignment in overrides]
    return WholeCurve(
        place.name,
        samples,
        models[model_name],
        model_name,
        segment=_segments(pipeline, samples),
        alignment=pipeline.alignment,
        uncertainties=pipeline.run.uncertainties,
        place=place,
        changed=any(table in _MATERIAL_TABLES for table in changed_tables),
    )


def _model_name(models: Mapping[str, ContactModel], requested: str | None, place: Path) -> str:
    """Return the requested model, or the only one; raises ConfigurationError for any other."""
    if requested is None and len(models) == 1:
        return next(iter(models))
    if requested is None:
        raise ConfigurationError(f"{place}: choose a model with --model (there are: {', '.join(models) or 'none'})")
    if requested not in models:
        raise ConfigurationError(f"{place}: no [model.{requested}]{suggest(requested, models)}")
    return requested


def _pipeline_samples(pipeline: Pipeline, place: Path) -> Samples:
    """Return the samples of a run of a pipeline, whose own output is removed; raises LogError for an empty record."""
    observer = SampleObserver()
    folder = Path(tempfile.mkdtemp(prefix="palpate-"))
    try:
        with progress(str(place), "s"):
            run_pipeline(pipeline, folder, report_progress, observer).demand_whole()
    finally:
        withdraw_folder(folder)
    if not observer.blocks:
        raise LogError(f"{place}: the record holds no samples")
    return Samples.joined(observer.blocks)


def _segments(pipeline: Pipeline, samples: Samples) -> Floats | None:
    """Return the segment (n,) of each sample, of a record whose stream of the position has a channel of that name.

    None for another record. A sample has the segment of the last reading before it, or of the first one.
    """
    # The signal is called DEVICE.STREAM.CHANNEL.
    signal = pipeline.alignment.position
    device_name, _, stream_and_channel = signal.channel.partition(".")
    stream_name = stream_and_channel.rpartition(".")[0]
    device = pipeline.devices[device_name]
    stream = next((stream for stream in device.streams if stream.name == stream_name), None)
    columns = [channel.name for channel in stream.channels] if stream is not None else []
    if _SEGMENT not in columns:
        return None

    # All readings of the stream, in the order of their time as the alignment takes it.
    with device.connect(pipeline.run.seed) as link:
        batches = [batch for batch in link.batches() if batch.stream == stream_name]
    time = np.concatenate([batch.time if signal.time == "stamp" else batch.received for batch in batches])
    segments = np.concatenate([batch.values[:, columns.index(_SEGMENT)] for batch in batches])
    order = np.argsort(time, kind="stable")
    delay = round(signal.delay * _NANOSECONDS)
    reading_index = np.searchsorted(time[order] - delay, samples.stamp, side="right") - 1
    return np.asarray(segments[order][np.maximum(reading_index, 0)], np.float64)


def source_of(place: Path) -> Source:
    """Return the pipeline that reads a record, as a source to be built; raises LogError or ConfigurationError."""
    if not place.exists():
        raise LogError(f"{place}: no such file or folder")
    if place.suffix == ".toml":
        return Source.read(place)
    if place.is_dir() and RunFolder(place).began:
        return _run_source(place)
    log = read_run_log(place)
    if log is None:
        raise ConfigurationError(
            f"{place}: carries no pipeline; `palpate info {place} --suggest -o pipeline.toml` writes one to start from"
        )
    typer.echo(f"{place}: tip, model and alignment are those of its run", err=True)
    return replay_source(log)


def _run_source(folder: Path) -> Source:
    """Return the replay of a run folder's log; of a run without one its pipeline, which may have read a log."""
    try:
        log = read_run_log(folder)
    except LogError:
        log = None
    if log is None:
        return Source.read(RunFolder(folder).pipeline, named=False)
    return replay_source(log)
