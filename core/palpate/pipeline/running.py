"""Run a pipeline, from the first batch to the written result."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate.alignment import Aligner
from palpate.config import Pipeline, resolved_text
from palpate.device import Batch
from palpate.errors import DeviceError
from palpate.pipeline.calibration_flags import calibration_flags
from palpate.pipeline.facts import flat_facts, run_facts
from palpate.pipeline.flow import Flow, Progress
from palpate.pipeline.interrupt import interruptible
from palpate.pipeline.outputs import Outputs
from palpate.pipeline.rest import declared_noise
from palpate.pipeline.tracks import RunningTrack, start_tracks
from palpate.result import (
    TrackResult,
    finite,
    make_folder,
    record_flags,
    stream_tables,
    track_result,
    write_new,
)
from palpate.sink import Run, Writer


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


def run_pipeline(
    pipeline: Pipeline, out: Path | None = None, progress: Progress | None = None, observer: Writer | None = None
) -> Result:
    """Run a pipeline to its end, or to Ctrl-C, and write the run folder; an observer sees what the sinks see.

    Raises UserError for what the user can mend; what was recorded until then stays.
    """
    running = start_tracks(pipeline)
    started = datetime.now(UTC).astimezone()
    folder = make_folder(pipeline.run.name, out, started)
    facts = run_facts(pipeline)
    documents = {"pipeline.toml": pipeline.text, "resolved.toml": resolved_text(pipeline)}
    for name, text in documents.items():
        write_new(folder / name, text)
    streams = {name: device.streams for name, device in pipeline.devices.items()}
    aligner = Aligner(pipeline.alignment, streams)
    tracks = {track.track.name: track.track.model.parameters for track in running}
    began = time.monotonic()
    failure: DeviceError | None = None
    with interruptible() as interrupt, ExitStack() as stack:
        run = Run(folder, streams, tracks, flat_facts(facts), documents)
        outputs = Outputs(stack, pipeline, run, running, observer)
        sampled = 0.0

        def take(device: str, batch: Batch) -> float:
            nonlocal sampled
            outputs.batch(device, batch)
            aligner.feed(device, batch)
            samples = aligner.samples()
            outputs.samples(samples, running)
            if len(samples):
                sampled = float(samples.time[-1])
                if progress is not None:
                    progress(sampled, flow.total)
            return sampled

        flow = Flow(pipeline, take, interrupt, declared_noise(pipeline))
        try:
            flow.run()
        except DeviceError as error:
            interrupt.reason, failure = f"stopped by a device: {error}", error
        outputs.finish(aligner, running)
    if flow.facts:
        facts["live"] = flow.facts
    facts |= {"started": started.isoformat(timespec="seconds"), "duration": time.monotonic() - began}
    result = _result(pipeline, folder, facts, aligner, running, interrupt.reason)
    write_new(folder / "result.json", json.dumps(result.table(), indent=2, allow_nan=False) + "\n")
    if failure is not None:
        raise DeviceError(f"{failure} (what was found until then is in {folder})") from failure
    return result


def _result(
    pipeline: Pipeline,
    folder: Path,
    facts: dict[str, Any],
    aligner: Aligner,
    running: list[RunningTrack],
    interrupted: str | None,
) -> Result:
    report, settings = aligner.report, pipeline.alignment
    tare, touch = report.tare, report.first_touch
    facts |= {
        "samples": report.samples,
        "log_duration": report.duration,
        "tare": {"offset": tare.offset, "std": tare.offset_std, "noise": tare.noise} if tare else None,
        "velocity_delay": {"value": late[0], "std": late[1]} if (late := report.velocity_delay) else None,
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
        (
            *warnings,
            *calibration_flags(pipeline, facts.get("live", {}).get("devices")),
            *record_flags(report, settings, interrupted),
        ),
        {name: value for d in pipeline.devices.values() for name, value in d.truth.items()},
        interrupted,
    )
