"""Run a pipeline, from the first batch to the written result."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate.alignment import Aligner
from palpate.config import Pipeline, resolved_text, taken_values
from palpate.device import truth_of
from palpate.errors import DeviceError, StoppedError, UserError
from palpate.flags import Flag
from palpate.pipeline.data_path import DataPath
from palpate.pipeline.device_flags import device_flags
from palpate.pipeline.facts import flat_facts, planned_duration, planned_extent, run_facts
from palpate.pipeline.flow import Arrivals, Flow, Progress, Taken
from palpate.pipeline.interrupt import Interrupt, interruptible
from palpate.pipeline.latency import Latency
from palpate.pipeline.outputs import Outputs
from palpate.pipeline.standstill import declared_noise
from palpate.pipeline.telling import Telling
from palpate.pipeline.tracks import Tracks, start_tracks
from palpate.result import (
    GIVEN,
    PIPELINE,
    RESULT,
    SCHEMA,
    TrackResult,
    finite,
    make_folder,
    record_flags,
    stream_tables,
    withdraw_folder,
)
from palpate.sink import Run, Writer
from palpate.writing import write_new

_BEHIND = 1.0  # [s]; estimates that were less late at worst have kept up


@dataclass(frozen=True)
class Result:
    """What a run found, and where it is written."""

    folder: Path
    run: Mapping[str, Any]
    streams: Mapping[str, Any]
    tracks: Mapping[str, TrackResult]
    flags: tuple[Flag, ...]  # those that concern every track
    truth: Mapping[str, float]
    interrupted: str | None
    signal: int = signal.SIGINT  # that interrupted it

    def demand_whole(self) -> None:
        """Raise StoppedError, with the exit code of the signal, where the run was stopped before its end."""
        if self.interrupted is not None:
            raise StoppedError(f"{self.interrupted}: partial, in {self.folder}", self.signal)

    def table(self) -> dict[str, Any]:
        """The contents of ``result.json``."""
        tracks = {name: track.table() for name, track in self.tracks.items()}
        for track in tracks.values():
            track["flags"] = [*(flag.table() for flag in self.flags), *track["flags"]]
        return {
            "schema": SCHEMA,
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
    live = any(device.live for device in pipeline.devices.values())
    beside = ThreadPoolExecutor(os.cpu_count() or 1)
    known = beside.submit(run_facts, pipeline)  # hashes of logs take as long as compiling
    tracks = Tracks(start_tracks(pipeline), None if live else beside)
    started = datetime.now(UTC).astimezone()
    folder = make_folder(pipeline.run.name, out, started)
    facts = known.result()
    aligner = Aligner(pipeline.alignment, pipeline.ports)
    began = time.monotonic()
    failure: DeviceError | None = None
    taken = False
    with refused_leaves_nothing(folder, lambda: taken), interruptible() as interrupt, ExitStack() as stack:
        run = _described(pipeline, folder, facts, tracks, interrupt)
        stack.enter_context(beside)
        outputs = Outputs(stack, pipeline, run, tracks.online, observer)
        latency = Latency(pipeline.ports["position"]) if live and pipeline.tracks else None
        path = DataPath(aligner, tracks, outputs, latency)
        backlog = path.backlog

        def show() -> Taken:
            now = {"time": aligner.reached, "behind": backlog.behind}
            telling.look(now)
            if progress is not None and aligner.reached:
                progress(aligner.reached, flow.total, backlog.behind)
            return Taken(aligner.reached, backlog.behind)

        def take(arrivals: Arrivals) -> Taken:
            nonlocal taken
            taken = True
            path.step(arrivals)
            return show()

        flow = Flow(pipeline, take, interrupt, declared_noise(pipeline))
        telling = Telling(outputs.writers, flow, aligner, tracks, pipeline)
        try:
            flow.run()
        except DeviceError as error:
            interrupt.reason, failure = f"stopped by a device: {error}", error
        for _ in path.finish(lambda: interrupt.reason is not None):
            show()
        telling.last({"time": aligner.reached, "behind": 0.0})
        if latency is not None:
            told = {"largest_behind": backlog.largest, "until": backlog.given_up}
            flow.facts["estimates"] = {"latency": latency.table(), **told}
        if flow.facts:
            facts["live"] = flow.facts
        facts |= {"started": started.isoformat(timespec="seconds"), "duration": time.monotonic() - began}
        result = _result(pipeline, folder, facts, aligner, tracks, interrupt)
        outputs.finish(result.table())
    write_new(folder / RESULT, json.dumps(result.table(), indent=2, allow_nan=False) + "\n")
    if failure is not None:
        raise DeviceError(f"{failure} (what was found until then is in {folder})") from failure
    return result


def _described(pipeline: Pipeline, folder: Path, facts: dict[str, Any], tracks: Tracks, by: Interrupt) -> Run:
    """What sinks are told of a run, with its documents written."""
    documents = {PIPELINE: resolved_text(pipeline), GIVEN: pipeline.text}
    for name, text in documents.items():
        write_new(folder / name, text)
    return Run(
        folder=folder,
        streams=pipeline.ports.streams,
        tracks={track.track.name: track.track.model.parameters for track in tracks.running},
        facts=flat_facts(facts),
        documents=documents,
        name=pipeline.run.name,
        duration=planned_duration(pipeline),
        extent=planned_extent(pipeline),
        stop=by.stop,
    )


@contextmanager
def refused_leaves_nothing(folder: Path, begun: Callable[[], bool]) -> Iterator[None]:
    """Removes the folder of a run that its pipeline, its log or its output refuses before it has recorded anything."""
    try:
        yield
    except UserError:
        if not begun():
            withdraw_folder(folder)
        raise


def assumed_flags(pipeline: Pipeline) -> Iterator[Flag]:
    """What the run took for known although nobody has stated it."""
    known = taken_values(pipeline)
    if told := [f"{key} = {known.get(key, '? (there is no such setting)')}" for key in pipeline.run.assumed]:
        yield Flag("assumed", f"nobody has stated {', '.join(told)}")


def backlog_flags(estimates: Mapping[str, Any] | None) -> Iterator[Flag]:
    """Whether the estimates of a live run kept up."""
    if estimates is None or estimates["largest_behind"] < _BEHIND:
        return
    behind = f"the estimates were up to {estimates['largest_behind']:.1f} s behind the readings"
    if (until := estimates["until"]) is None:
        yield Flag("backlog", f"{behind}; all of them were made in the end")
    else:
        yield Flag(
            "backlog", f"{behind} and end at {until:.2f} s; the recording is whole, and its replay makes the rest"
        )


def _result(
    pipeline: Pipeline,
    folder: Path,
    facts: dict[str, Any],
    aligner: Aligner,
    tracks: Tracks,
    interrupt: Interrupt,
) -> Result:
    report, settings = aligner.report, pipeline.alignment
    tare, touch = report.tare, report.first_touch
    facts |= {
        "samples": report.samples,
        "log_duration": report.duration,
        "tare": {"offset": tare.offset, "std": tare.offset_std, "noise": tare.noise, "until": tare.until}
        if tare
        else None,
        "velocity_delay": {"value": late[0], "std": late[1]} if (late := report.velocity_delay) else None,
        "first_touch": {
            "time": touch[0],
            "position": touch[1],
            "by": "change-point" if report.by_change_point else "threshold",
            "lag": settings.touch_lag,
        }
        if touch
        else None,
    }
    told = facts.get("live", {}).get("devices")  # by connected devices of themselves
    flags = pipeline.registry.judged(
        (
            *pipeline.renamed,
            *assumed_flags(pipeline),
            *(Flag("device", text) for device in pipeline.devices.values() for text in device.warnings),
            *(calibration.flags(pipeline, told or {}) if (calibration := pipeline.calibration) else ()),
            *backlog_flags(facts.get("live", {}).get("estimates")),
            *device_flags(settings, pipeline.ports, told),
            *record_flags(report, settings, interrupt.reason),
        )
    )
    return Result(
        folder,
        {key: finite(value) for key, value in facts.items()},
        stream_tables(report),
        {name: found.judged(pipeline.registry, flags) for name, found in tracks.results(pipeline, report).items()},
        flags,
        truth_of(pipeline.devices),
        interrupt.reason,
        interrupt.signal,
    )
