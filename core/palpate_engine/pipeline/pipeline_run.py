"""Run a pipeline, from the first batch to the written result."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from errno import EMFILE, ENFILE
from pathlib import Path
from threading import Event
from typing import Any

from palpate.clocks import clock
from palpate.device import is_live
from palpate.errors import DeviceError, OutputError, UserError, error_text
from palpate.sink import Run, Writer

from palpate_engine.atomic_files import write_new
from palpate_engine.config import Pipeline, resolved_text
from palpate_engine.pipeline.closing_reserve import ClosingReserve, closing_reserve
from palpate_engine.pipeline.interrupt import Interrupt, interruptible
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.provenance import facts_beside, flat_facts, lift_facts, planned_duration, planned_extent
from palpate_engine.pipeline.rehearsal import rehearsal_facts, simulated_time
from palpate_engine.pipeline.run_result import Result, build_result
from palpate_engine.pipeline.session import Observer, Session
from palpate_engine.pipeline.tracks import Tracks, start_tracks
from palpate_engine.result import GIVEN, PIPELINE, RESULT, make_folder, withdraw_folder


def run_pipeline(
    pipeline: Pipeline,
    out: Path | None = None,
    progress: Observer | None = None,
    observer: Writer | None = None,
    rehearsal: Mapping[str, Any] | None = None,
) -> Result:
    """Run a pipeline to its end, or to Ctrl-C, and write the run folder; an observer sees what the sinks see.

    One with ``[run] rehearsal`` is run in simulated time; `rehearsal` says which faults, hold-ups and seed that has.

    Raises UserError for what the user can mend; what was recorded until then stays.
    """
    with simulated_time(pipeline):
        return _run(pipeline, out, progress, observer, rehearsal)


def _run(
    pipeline: Pipeline,
    out: Path | None,
    progress: Observer | None,
    observer: Writer | None,
    rehearsal: Mapping[str, Any] | None,
) -> Result:
    """Run a pipeline, as `run_pipeline` says, in the time that is set.

    The result is written also where something fails after the first batch; a folder of a run that is refused is
    removed.
    """
    if lift := lift_facts(pipeline):  # nothing is touched that could be estimated
        pipeline = replace(pipeline, tracks=())
    # Hashing the inputs and the tracks of a replay go on in threads.
    live = is_live(pipeline.devices)
    provenance = facts_beside(pipeline)
    executor = ThreadPoolExecutor(os.cpu_count() or 1, "tracks")
    tracks = Tracks(start_tracks(pipeline), None if live else executor)
    started = datetime.now(UTC).astimezone()  # the day on which it is made, also in simulated time
    folder = make_folder(pipeline.run.name, out, started)
    facts = provenance.result() | lift | rehearsal_facts(pipeline, rehearsal)
    # `begun` is set at the first batch; `room` is a file that keeps place on the disk for the end of the run.
    with remove_refused_folder(folder) as begun, interruptible() as interrupt, closing_reserve(folder, live) as room:
        work = _RunContext(
            pipeline=pipeline,
            folder=folder,
            facts=facts,
            tracks=tracks,
            interrupt=interrupt,
            started=started,
            began=clock().now(),
        )
        session: Session | None = None
        result: Result | None = None
        failure: Exception | None = None
        try:
            with ExitStack() as stack:
                stack.enter_context(executor)
                # Outputs are open before the session, which connects the devices.
                outputs = work.outputs(stack, room, observer)
                session = work.session(outputs, progress, begun)
                # Batches until the end; a failure of a device does not keep the outputs from closing.
                failure = session.run()
                result = work.result(session)
                outputs.finish(result.table())
                room.release()
        except Exception as error:
            # Before the first batch the run is refused, and leaves nothing.
            if session is None or not begun.is_set():
                raise
            if failure is None or result is None:  # the outputs do not close: what was recorded is not whole
                interrupt.stop(error_text(error))
                result, failure = work.result(session), failure or error
        # A result is written in any case; its place is part of the message of a failure.
        place = _written(result, folder, room)
    if isinstance(failure, DeviceError | UserError):
        raise type(failure)(f"{failure} (what was found until then is in {place})") from failure
    if failure is not None:
        raise failure
    return result


@dataclass(frozen=True)
class _RunContext:
    """Facts of a run from its beginning to its result."""

    pipeline: Pipeline
    folder: Path
    facts: Mapping[str, Any]
    tracks: Tracks
    interrupt: Interrupt
    started: datetime
    began: float  # [s]

    def outputs(self, stack: ExitStack, room: ClosingReserve, observer: Writer | None) -> Outputs:
        """Return the sinks of the run, open until the stack closes."""
        return Outputs(
            stack=stack,
            pipeline=self.pipeline,
            run=self.described(),
            online=self.tracks.online,
            stop=self.interrupt.stop,
            room=room,
            observer=observer,
        )

    def session(self, outputs: Outputs, progress: Observer | None, begun: Event) -> Session:
        """Return the session that reads the devices; `begun` is set with its first batch."""
        return Session(
            pipeline=self.pipeline,
            tracks=self.tracks,
            outputs=outputs,
            interrupt=self.interrupt,
            observe=progress,
            begun=begun,
        )

    def described(self) -> Run:
        """Return the description of the run that sinks get, with its documents written."""
        pipeline = self.pipeline
        documents = {PIPELINE: resolved_text(pipeline), GIVEN: pipeline.text}
        for name, text in documents.items():
            write_new(self.folder / name, text)
        return Run(
            folder=self.folder,
            streams=pipeline.ports.streams,
            tracks={track.track.name: track.track.model.parameters for track in self.tracks.running},
            facts=flat_facts(self.facts),
            documents=documents,
            name=pipeline.run.name,
            duration=planned_duration(pipeline),
            extent=planned_extent(pipeline),
            surface=pipeline.alignment.surface,
            stop=self.interrupt.stop,
        )

    def result(self, session: Session) -> Result:
        """Return the result as it is now."""
        live, report = session.live, session.report
        facts = {**self.facts, **({} if live is None else {"live": live.table()})}
        facts |= {"started": self.started.isoformat(timespec="seconds"), "duration": clock().now() - self.began}
        results = self.tracks.results(self.pipeline, report)
        return build_result(self.pipeline, self.folder, facts, live, report, tracks=results, interrupt=self.interrupt)


def _written(result: Result, folder: Path, room: ClosingReserve) -> Path:
    """Write ``result.json`` into its folder, recreated if it is gone, else into the folder of temporary files.

    Where no further file can be opened, it becomes the one that the run has kept open.
    """
    text = json.dumps(result.table(), indent=2, allow_nan=False) + "\n"
    try:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        write_new(folder / RESULT, text)
        return folder
    except OutputError as error:
        if isinstance(error.__cause__, OSError) and error.__cause__.errno in (EMFILE, ENFILE):
            room.release()
            if room.write(folder / RESULT, text):
                return folder
        if result.interrupted is None:
            raise
    place = Path(tempfile.mkdtemp(prefix=f"palpate-{folder.name}-"))
    write_new(place / RESULT, text)
    return place


@contextmanager
def remove_refused_folder(folder: Path) -> Iterator[Event]:
    """Remove the folder of a run that is refused (by pipeline, log or output) before the event, its first batch."""
    begun = Event()
    try:
        yield begun
    except UserError:
        if not begun.is_set():
            withdraw_folder(folder)
        raise
