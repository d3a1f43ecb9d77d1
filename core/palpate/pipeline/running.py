"""Run a pipeline, from the first batch to the written result."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate.alignment import Aligner
from palpate.config import Pipeline, resolved_text
from palpate.errors import DeviceError, UserError
from palpate.pipeline.concluding import Result, concluded
from palpate.pipeline.data_path import DataPath
from palpate.pipeline.facts import facts_beside, flat_facts, planned_duration, planned_extent
from palpate.pipeline.flow import Arrivals, Flow, Progress, Taken
from palpate.pipeline.interrupt import Interrupt, interruptible
from palpate.pipeline.latency import Latency
from palpate.pipeline.outputs import Outputs
from palpate.pipeline.standstill import declared_noise
from palpate.pipeline.telling import Telling
from palpate.pipeline.tracks import Tracks, start_tracks
from palpate.result import GIVEN, PIPELINE, RESULT, make_folder, withdraw_folder
from palpate.sink import Run, Writer
from palpate.writing import write_new


def run_pipeline(
    pipeline: Pipeline, out: Path | None = None, progress: Progress | None = None, observer: Writer | None = None
) -> Result:
    """Run a pipeline to its end, or to Ctrl-C, and write the run folder; an observer sees what the sinks see.

    Raises UserError for what the user can mend; what was recorded until then stays.
    """
    live = any(device.live for device in pipeline.devices.values())
    known, beside = facts_beside(pipeline), ThreadPoolExecutor(os.cpu_count() or 1, "tracks")
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
            behind = {"largest_behind": backlog.largest, "until": backlog.given_up}
            flow.facts["estimates"] = {"latency": latency.table(), **behind}
        if flow.facts:
            facts["live"] = flow.facts
        facts |= {"started": started.isoformat(timespec="seconds"), "duration": time.monotonic() - began}
        report = aligner.report
        result = concluded(pipeline, folder, facts, report, tracks.results(pipeline, report), interrupt)
        outputs.finish(result.table())
    write_new(folder / RESULT, json.dumps(result.table(), indent=2, allow_nan=False) + "\n")
    if failure is not None:
        raise DeviceError(f"{failure} (what was found until then is in {folder})") from failure
    return result


def _described(pipeline: Pipeline, folder: Path, facts: dict[str, Any], tracks: Tracks, by: Interrupt) -> Run:
    """The description of a run that sinks get, with its documents written."""
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
