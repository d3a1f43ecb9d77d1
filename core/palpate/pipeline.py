"""Run a pipeline: devices -> alignment -> tracks -> sinks -> result."""

from __future__ import annotations

import importlib.metadata
import json
import math
import platform
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate.alignment import Aligner
from palpate.config import Pipeline, Track, resolved_text
from palpate.device import Arm, Batch, Link
from palpate.errors import ConfigurationError, DeviceError, OutputError
from palpate.estimation import Estimates, Problem, Samples, Tracker
from palpate.result import (
    EstimatesFile,
    TrackRecord,
    TrackResult,
    finite,
    make_folder,
    record_flags,
    stream_tables,
    timing_uncertainty,
    track_result,
    write_new,
)
from palpate.sink import Run, Writer

Progress = Callable[[float, float | None], None]  # log time [s], total [s] where known

_LIBRARIES = ("casadi", "numpy", "scipy", "pydantic", "pint", "pluggy", "mcap")


@dataclass(frozen=True)
class Result:
    """What a run found, and where it is written."""

    folder: Path
    run: Mapping[str, Any]
    streams: Mapping[str, Any]
    tracks: Mapping[str, TrackResult]
    flags: tuple[str, ...]  # those that concern every track
    truth: Mapping[str, float]
    interrupted: str | None

    def table(self) -> dict[str, Any]:
        """The contents of ``result.json``."""
        tracks = {name: track.table() for name, track in self.tracks.items()}
        for track in tracks.values():
            track["flags"] = [*self.flags, *track["flags"]]
        return {
            "palpate": self.run["versions"]["palpate"],
            "run": dict(self.run),
            "streams": dict(self.streams),
            "truth": dict(self.truth),
            "tracks": tracks,
        }


@dataclass
class _Running:
    """A track at work."""

    track: Track
    tracker: Tracker
    record: TrackRecord
    waiting: list[Samples] = field(default_factory=list)  # an offline estimator wants them all at once

    def run(self, samples: Samples) -> Estimates:
        before = time.perf_counter()
        estimates = self.tracker.run(samples)
        self.record.add(samples, estimates, time.perf_counter() - before)
        return estimates


def run_pipeline(
    pipeline: Pipeline, out: Path | None = None, progress: Progress | None = None, observer: Writer | None = None
) -> Result:
    """Run a pipeline to its end, or to Ctrl-C, and write the run folder; an observer sees what the sinks see.

    Raises UserError for what the user can mend; what was recorded until then stays.
    """
    running = start_tracks(pipeline)
    started = datetime.now(UTC).astimezone()
    folder = make_folder(pipeline.run.name, out, started)
    facts = _facts(pipeline)
    documents = {"pipeline.toml": pipeline.text, "resolved.toml": resolved_text(pipeline)}
    for name, text in documents.items():
        write_new(folder / name, text)
    streams = {name: device.streams for name, device in pipeline.devices.items()}
    aligner = Aligner(pipeline.alignment, streams)
    tracks = {track.track.name: track.track.model.parameters for track in running}
    began = time.monotonic()
    interrupted = failure = None
    with ExitStack() as stack:
        run = Run(
            folder, streams, tracks, {**facts["versions"], **facts["inputs"], "seed": str(facts["seed"])}, documents
        )
        outputs = _Outputs(stack, pipeline, run, running, observer)
        try:
            _flow(stack, pipeline, aligner, running, outputs, progress)
        except KeyboardInterrupt:
            interrupted = "stopped by the user; the result is what was found until then"
        except DeviceError as error:
            interrupted, failure = f"stopped by a device: {error}", error
        outputs.finish(aligner, running)
    facts |= {"started": started.isoformat(timespec="seconds"), "duration": time.monotonic() - began}
    result = _result(pipeline, folder, facts, aligner, running, interrupted)
    write_new(folder / "result.json", json.dumps(result.table(), indent=2, allow_nan=False) + "\n")
    if failure is not None:
        raise DeviceError(f"{failure} (what was found until then is in {folder})") from failure
    return result


def start_tracks(pipeline: Pipeline) -> list[_Running]:
    """Every track with a fresh tracker; raises ConfigurationError where an estimator cannot start."""
    keep = max(3.0 * pipeline.run.average, 1.0)
    running = []
    for track in pipeline.tracks:
        problem = Problem(track.model, pipeline.alignment.tip_mass, timing_uncertainty(pipeline.alignment))
        try:
            tracker = track.estimator.start(problem)
        except ConfigurationError as error:
            raise ConfigurationError(f"{pipeline.path}: [estimator.{track.name.split('/')[-1]}]: {error}") from error
        # An offline estimate holds for all of its samples, so all of them are looked at.
        running.append(_Running(track, tracker, TrackRecord(keep if track.estimator.online else math.inf)))
    return running


class _Outputs:
    """Sinks and the table of estimates, all open."""

    def __init__(
        self, stack: ExitStack, pipeline: Pipeline, run: Run, running: list[_Running], observer: Writer | None = None
    ) -> None:
        self._writers: list[Writer] = [stack.enter_context(sink.open(run)) for sink in pipeline.sinks.values()]
        self._writers += [observer] if observer is not None else []
        path = run.folder / "estimates.csv"
        try:
            file = stack.enter_context(path.open("x", newline="", encoding="utf-8"))
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from error
        online = {r.track.name: r.track.model.parameters for r in running if r.track.estimator.online}
        self._table = EstimatesFile(file, online, pipeline.run.estimates_interval)

    def batch(self, device: str, batch: Batch) -> None:
        for writer in self._writers:
            writer.batch(device, batch)

    def samples(self, samples: Samples, running: list[_Running]) -> None:
        """Through every track, and out."""
        if not len(samples):
            return
        for writer in self._writers:
            writer.samples(samples)
        found = {}
        for track in running:
            if track.track.estimator.online:
                found[track.track.name] = track.run(samples)
                self._write(track.track.name, found[track.track.name])
            else:
                track.waiting.append(samples)
        self._table.write(found)

    def finish(self, aligner: Aligner, running: list[_Running]) -> None:
        """The rest of the record, then the offline estimators."""
        self.samples(aligner.samples(final=True), running)
        for track in running:
            if track.waiting:
                self._write(track.track.name, track.run(Samples.joined(track.waiting)))
                track.waiting = []

    def _write(self, name: str, estimates: Estimates) -> None:
        for writer in self._writers:
            writer.estimates(name, estimates)


def _flow(
    stack: ExitStack,
    pipeline: Pipeline,
    aligner: Aligner,
    running: list[_Running],
    outputs: _Outputs,
    progress: Progress | None,
) -> None:
    """Connect, set in motion, and pass every batch on until there are no more."""
    links = {name: stack.enter_context(d.connect(pipeline.run.seed)) for name, d in pipeline.devices.items()}
    arms = [link for link in links.values() if isinstance(link, Arm)]
    total = max((d.duration for d in pipeline.devices.values() if d.duration is not None), default=None)
    if arms:
        trajectory = _the_trajectory(pipeline)
        total = trajectory.total_duration
        for arm in arms:
            arm.follow(trajectory)
    try:
        for device, batch in _merged(links):
            outputs.batch(device, batch)
            aligner.feed(device, batch)
            samples = aligner.samples()
            outputs.samples(samples, running)
            if progress is not None and len(samples):
                progress(float(samples.time[-1]), total)
    finally:
        for arm in arms:
            arm.stop()


def _the_trajectory(pipeline: Pipeline) -> Any:
    if len(pipeline.trajectories) != 1:
        count = len(pipeline.trajectories)
        raise ConfigurationError(f"{pipeline.path}: a device that moves needs one [trajectory.*] table, not {count}")
    return next(iter(pipeline.trajectories.values()))


def _merged(links: Mapping[str, Link]) -> Iterator[tuple[str, Batch]]:
    """Batches of all links, always from the one that is furthest behind in time."""
    streams = {name: link.batches() for name, link in links.items()}
    heads: dict[str, Batch] = {}
    while True:
        for name in [name for name in streams if name not in heads]:
            batch = next((batch for batch in streams[name] if len(batch.time)), None)
            if batch is None:
                del streams[name]
            else:
                heads[name] = batch
        if not heads:
            return
        name = min(heads, key=lambda name: int(heads[name].received[0]))
        yield name, heads.pop(name)


def _facts(pipeline: Pipeline) -> dict[str, Any]:
    """What it takes to redo the run."""
    versions = {"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()}
    versions |= {name: importlib.metadata.version(name) for name in _LIBRARIES}
    inputs = {f"{name}.{key}": text for name, d in pipeline.devices.items() for key, text in d.provenance.items()}
    return {
        "name": pipeline.run.name,
        "pipeline": str(pipeline.path),
        "command": sys.argv,
        "seed": pipeline.run.seed,
        "versions": versions,
        "plugins": [plugin.name for plugin in pipeline.registry.plugins],
        "inputs": inputs,
        "host": socket.gethostname(),
    }


def _result(
    pipeline: Pipeline,
    folder: Path,
    facts: dict[str, Any],
    aligner: Aligner,
    running: list[_Running],
    interrupted: str | None,
) -> Result:
    report, settings = aligner.report, pipeline.alignment
    tare, touch = report.tare, report.first_touch
    facts |= {
        "samples": report.samples,
        "log_duration": report.duration,
        "tare": {"offset": tare.offset, "std": tare.offset_std, "noise": tare.noise} if tare else None,
        "first_touch": {"time": touch[0], "position": touch[1]} if touch else None,
    }
    warnings = [f"device: {text}" for device in pipeline.devices.values() for text in device.warnings]
    return Result(
        folder,
        {key: finite(value) for key, value in facts.items()},
        stream_tables(report),
        {
            r.track.name: track_result(
                r.track.name, r.track.model, r.record, report, settings, pipeline.run.average, r.track.estimator.online
            )
            for r in running
        },
        (*warnings, *record_flags(report, settings, interrupted)),
        {name: value for d in pipeline.devices.values() for name, value in d.truth.items()},
        interrupted,
    )
