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
    """Sinks and the table of estimates, all open."""

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
        path = run.folder / "estimates.csv"
        try:
            file = stack.enter_context(path.open("x", newline="", encoding="utf-8"))
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from error
        online = {r.track.name: r.track.model.parameters for r in running if r.track.estimator.online}
        self._table = EstimatesFile(file, online, pipeline.run.estimates_interval)

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
        self._table.write(found)

    def finish(self, aligner: Aligner, running: list[RunningTrack]) -> None:
        """The rest of the record, then the offline estimators."""
        self.samples(aligner.samples(final=True), running)
        for track in running:
            if track.waiting:
                self._write(track.track.name, track.run(Samples.joined(track.waiting)))
                track.waiting = []

    def _write(self, name: str, estimates: Estimates) -> None:
        for writer in self._writers:
            writer.estimates(name, estimates)
