"""The outputs of a run while it goes on: sinks, and tables of estimates."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from operator import methodcaller
from pathlib import Path
from typing import Any, TypeVar

from palpate.clocks import clock
from palpate.device import Batch
from palpate.errors import OutputError, error_text
from palpate.estimation import Estimates, Samples
from palpate.offers import context_of, function_of
from palpate.sink import EstimatesWriter, Run, TakesResult, Writer

from palpate_engine.config import Pipeline
from palpate_engine.pipeline.closing_reserve import ClosingReserve
from palpate_engine.pipeline.plugin_failure import third_party_error
from palpate_engine.pipeline.tracks import RunningTrack

_LOOK_INTERVAL = 0.1  # [s]; a choice


_Output = TypeVar("_Output")


class Outputs:
    """Sinks and the tables of estimates, all open.

    One that fails is written to no more: `stop` is asked for, and the room that was kept back is given up.
    """

    def __init__(
        self,
        stack: ExitStack,
        pipeline: Pipeline,
        run: Run,
        online: Sequence[RunningTrack],
        stop: Callable[[str], None],
        room: ClosingReserve,
        observer: Writer | None = None,
    ) -> None:
        """Open sinks and tables of estimates of a run within a stack; `stop` ends the run where one fails.

        A table is for each of the `online` tracks; `room` is the place on the disk that is kept back for the end.
        """
        self.writers: list[Writer] = [
            stack.enter_context(context_of(sink.open(run), f"sink {name}: {type(sink).__name__}.open"))
            for name, sink in pipeline.sinks.items()
        ]
        self.writers += [observer] if observer is not None else []
        self.failure: Exception | None = None  # the first
        self._run, self._stack, self._pipeline, self._stop = run, stack, pipeline, stop
        self._room, self._folder = room, FolderWatch(run.folder)
        self._tables = self._open_tables([track.track.name for track in online])

    def _open_tables(self, tracks: Iterable[str], offline: bool = False) -> list[EstimatesWriter]:
        """Open the tables of estimates of some tracks, one for each recorder; they close with the run."""
        parameters = {track: self._run.tracks[track] for track in tracks}
        tables: list[EstimatesWriter] = []
        for name, recorder in self._pipeline.registry.recorders.items():
            table = function_of(recorder)(self._run.folder, parameters, self._pipeline, offline)
            tables.append(self._stack.enter_context(context_of(table, f"recorder {name}")))
        return tables

    def record(self, arrivals: Iterable[tuple[str, Batch]]) -> None:
        """Write raw readings, each with its device; stop the run where its folder is gone."""
        if self.failure is None and self._folder.is_gone:
            self._fail(OutputError(f"{self._run.folder}: the run folder is gone: was it moved, deleted or unmounted?"))
        for device, batch in arrivals:
            self._write_all(self.writers, methodcaller("batch", device, batch))

    def write(self, samples: Samples, estimates: Mapping[str, Estimates] | None) -> None:
        """Write samples, and the estimates of the online tracks; None if the run has none."""
        if not len(samples):
            return
        self._write_all(self.writers, methodcaller("samples", samples))
        if estimates is not None:
            self._write_estimates(estimates)
            self._write_all(self._tables, methodcaller("write", samples, estimates))

    def write_offline(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """Write estimates that were made of all samples after the record, into a table of their own."""
        self._write_estimates(estimates)
        self._write_all(self._open_tables(estimates, offline=True), methodcaller("write", samples, estimates))

    def _write_estimates(self, estimates: Mapping[str, Estimates]) -> None:
        """Write a block of estimates of each track to the sinks."""
        for track, block in estimates.items():
            self._write_all(self.writers, methodcaller("estimates", track, block))

    def finish(self, table: Mapping[str, Any]) -> None:
        """Write the result to the sinks that take it."""
        self._write_all(self.writers, lambda writer: writer.result(table) if isinstance(writer, TakesResult) else None)

    def _write_all(self, outputs: list[_Output], write: Callable[[_Output], None]) -> None:
        """Write to each of some outputs; one that fails is removed from them, and the run stops."""
        for output in list(outputs):
            try:
                write(output)
            except Exception as error:
                outputs.remove(output)
                self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Stop the run at the first failure, and release the room that was kept back."""
        if self.failure is None:
            if isinstance(error, OSError):
                error = OutputError(f"{self._run.folder}: cannot write: {error.strerror or error}")
            self.failure = third_party_error(error, self._pipeline.registry)
            self._room.release()
            self._stop(error_text(self.failure))


class FolderWatch:
    """Compares, ten times a second, the folder at a path with the one that was there at first."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._last_look = folder, clock().now()
        self._identity = _identity(folder)

    @property
    def is_gone(self) -> bool:
        """True if the folder is known to have been moved or deleted."""
        if clock().now() - self._last_look < _LOOK_INTERVAL:
            return False
        self._last_look = clock().now()
        return _identity(self._folder) != self._identity


def _identity(folder: Path) -> tuple[int, int] | None:
    """Return device and inode of a folder; None without access to one."""
    try:
        status = os.stat(folder)
    except OSError:
        return None
    return status.st_dev, status.st_ino
