"""Where everything goes while a run goes on: into the sinks and the tables of estimates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from palpate.config import Pipeline
from palpate.device import Batch
from palpate.estimation import Estimates, Samples
from palpate.offers import function_of
from palpate.pipeline.tracks import RunningTrack
from palpate.sink import EstimatesWriter, Run, TakesResult, Writer


class Outputs:
    """Sinks and the tables of estimates, all open; it writes, and does nothing else."""

    def __init__(
        self,
        stack: ExitStack,
        pipeline: Pipeline,
        run: Run,
        online: Sequence[RunningTrack],
        observer: Writer | None = None,
    ) -> None:
        self.writers: list[Writer] = [stack.enter_context(sink.open(run)) for sink in pipeline.sinks.values()]
        self.writers += [observer] if observer is not None else []
        self._run, self._stack, self._pipeline = run, stack, pipeline
        self._tables = self._opened([track.track.name for track in online])

    def _opened(self, tracks: Iterable[str], offline: bool = False) -> list[EstimatesWriter]:
        wanted = {track: self._run.tracks[track] for track in tracks}
        recorders = [function_of(recorder) for recorder in self._pipeline.registry.recorders.values()]
        opened = (recorder(self._run.folder, wanted, self._pipeline, offline) for recorder in recorders)
        return [self._stack.enter_context(table) for table in opened]

    def record(self, arrivals: Iterable[tuple[str, Batch]]) -> None:
        """Raw readings, each with its device."""
        for device, batch in arrivals:
            for writer in self.writers:
                writer.batch(device, batch)

    def write(self, samples: Samples, estimates: Mapping[str, Estimates] | None) -> None:
        """Samples, and the estimates of the online tracks; None where there are none."""
        if not len(samples):
            return
        for writer in self.writers:
            writer.samples(samples)
        if estimates is not None:
            self._hand_out(estimates)
            for table in self._tables:
                table.write(samples, estimates)

    def write_offline(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """Estimates that were made of all samples after the record; they get a table of their own."""
        self._hand_out(estimates)
        for table in self._opened(estimates, offline=True):
            table.write(samples, estimates)

    def _hand_out(self, estimates: Mapping[str, Estimates]) -> None:
        for track, found in estimates.items():
            for writer in self.writers:
                writer.estimates(track, found)

    def finish(self, table: Mapping[str, Any]) -> None:
        """The result, for those who want it."""
        for writer in self.writers:
            if isinstance(writer, TakesResult):
                writer.result(table)
