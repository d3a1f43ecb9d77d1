"""The data path: from readings to estimates, live or replayed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from palpate.clocks import clock
from palpate.device import Batch

from palpate_engine.alignment import Aligner
from palpate_engine.pipeline.backlog import Backlog
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.tracks import Tracks

_STOPPED_PATIENCE = 1.0  # [s] for the backlog of a run that was stopped; a choice


class DataPath:
    """Takes readings to estimates, in one place."""

    def __init__(self, aligner: Aligner, tracks: Tracks, outputs: Outputs, latency: Latency | None = None) -> None:
        self._aligner, self._tracks, self._outputs = aligner, tracks, outputs
        self._latency = latency  # of a live run
        self.backlog = Backlog(latency)

    def step(self, arrivals: Sequence[tuple[str, Batch]], final: bool = False) -> None:
        """Record, align, estimate, write what has arrived; with `final`, all that the record still holds.

        A live run that is behind estimates a slice of what waits, so that recording never waits for estimates.
        """
        if self._latency is not None and self.backlog.given_up is None:
            self._latency.arrived(arrivals)
        self._outputs.record(arrivals)
        samples = self.backlog.next(self._aligner.aligned(arrivals, final))
        estimates = self._tracks.estimate(samples) if self.backlog.given_up is None else None
        self._outputs.write(samples, estimates)
        self.backlog.served(samples)

    def finish(self, stopped: Callable[[], bool]) -> Iterator[None]:
        """Yield the rest of the record and of the backlog, slice by slice, then the offline estimators.

        A run that was `stopped` has little patience for its backlog: what is not estimated then is written as samples.
        """
        self.step([], final=True)
        deadline: float | None = None
        while self.backlog.behind:
            if stopped():
                deadline = deadline or clock().now() + _STOPPED_PATIENCE
                if clock().now() > deadline:
                    self.backlog.give_up()
            self.step([])
            yield
        if (offline := self._tracks.estimate_offline()) is not None:
            self._outputs.write_offline(*offline)
