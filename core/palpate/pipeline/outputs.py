"""Where everything goes while a run goes on: through the tracks, into the sinks and the table of estimates."""

from __future__ import annotations

from contextlib import ExitStack

from palpate.alignment import Aligner
from palpate.config import Pipeline
from palpate.device import Batch
from palpate.errors import OutputError
from palpate.estimation import Estimates, Samples
from palpate.pipeline.tracks import RunningTrack
from palpate.result import EstimatesFile
from palpate.sink import Run, Writer


class Outputs:
    """Sinks and the table of estimates, all open; estimates made after the record get a table of their own."""

    def __init__(
        self,
        stack: ExitStack,
        pipeline: Pipeline,
        run: Run,
        running: list[RunningTrack],
        observer: Writer | None = None,
    ) -> None:
        self._writers: list[Writer] = [stack.enter_context(sink.open(run)) for sink in pipeline.sinks.values()]
        self._writers += [observer] if observer is not None else []
        self._interval = pipeline.run.estimates_interval
        self._folder, self._stack = run.folder, stack
        self._table = self._open_table("estimates.csv", [r for r in running if r.track.estimator.online])

    def _open_table(self, name: str, running: list[RunningTrack]) -> EstimatesFile:
        path = self._folder / name
        try:
            file = self._stack.enter_context(path.open("x", newline="", encoding="utf-8"))
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from error
        return EstimatesFile(file, {r.track.name: r.track.model.parameters for r in running}, self._interval)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings, into the sinks."""
        for writer in self._writers:
            writer.batch(device, batch)

    def samples(self, samples: Samples, running: list[RunningTrack]) -> None:
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
        self._table.write(samples, found)

    def finish(self, aligner: Aligner, running: list[RunningTrack]) -> None:
        """The rest of the record, then the offline estimators."""
        self.samples(aligner.samples(final=True), running)
        offline = [track for track in running if track.waiting]
        if not offline:
            return
        samples, found = Samples.joined(offline[0].waiting), {}
        for track in offline:
            found[track.track.name] = track.run(samples)
            self._write(track.track.name, found[track.track.name])
            track.waiting = []
        self._open_table("estimates-offline.csv", offline).write(samples, found)

    def _write(self, name: str, estimates: Estimates) -> None:
        for writer in self._writers:
            writer.estimates(name, estimates)
