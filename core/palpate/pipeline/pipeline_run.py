"""Run a pipeline, from the first batch to the written result."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import Any

from palpate.atomic_files import write_new
from palpate.clocks import clock
from palpate.config import Pipeline, resolved_text
from palpate.device import is_live
from palpate.errors import DeviceError, UserError
from palpate.pipeline.interrupt import Interrupt, interruptible
from palpate.pipeline.outputs import Outputs
from palpate.pipeline.provenance import facts_beside, flat_facts, planned_duration, planned_extent
from palpate.pipeline.run_result import Result, build_result
from palpate.pipeline.session import Observer, Session
from palpate.pipeline.tracks import Tracks, start_tracks
from palpate.result import GIVEN, PIPELINE, RESULT, make_folder, withdraw_folder
from palpate.sink import Run, Writer


def run_pipeline(
    pipeline: Pipeline,
    out: Path | None = None,
    progress: Observer | None = None,
    observer: Writer | None = None,
    rehearsal: Mapping[str, Any] | None = None,
) -> Result:
    """Run a pipeline to its end, or to Ctrl-C, and write the run folder; an observer sees what the sinks see.

    `rehearsal` is what a run against a twin says of that: its name, its specimen, faults and hold-ups.

    Raises UserError for what the user can mend; what was recorded until then stays.
    """
    live = is_live(pipeline.devices)
    known, beside = facts_beside(pipeline), ThreadPoolExecutor(os.cpu_count() or 1, "tracks")
    tracks = Tracks(start_tracks(pipeline), None if live else beside)
    started = datetime.fromtimestamp(clock().epoch_ns() / 1e9, UTC).astimezone()
    folder = make_folder(pipeline.run.name, out, started)
    facts = known.result() | ({} if rehearsal is None else {"rehearsal": rehearsal})
    began = clock().now()
    with remove_refused_folder(folder) as begun, interruptible() as interrupt, ExitStack() as stack:
        run = _described(pipeline, folder, facts, tracks, interrupt)
        stack.enter_context(beside)
        outputs = Outputs(stack, pipeline, run, tracks.online, observer)
        session = Session(pipeline, tracks, outputs, interrupt, progress, begun)
        failure = session.run()
        live_facts = session.live
        if live_facts is not None:
            facts["live"] = live_facts.table()
        facts |= {"started": started.isoformat(timespec="seconds"), "duration": clock().now() - began}
        report = session.report
        found = tracks.results(pipeline, report)
        result = build_result(pipeline, folder, facts, live_facts, report, found, interrupt)
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
def remove_refused_folder(folder: Path) -> Iterator[Event]:
    """Removes the folder of a run that is refused (by pipeline, log or output) before the event, its first batch."""
    begun = Event()
    try:
        yield begun
    except UserError:
        if not begun.is_set():
            withdraw_folder(folder)
        raise
