"""A run in progress: from the first batch to the last estimate."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Event
from typing import Any

from palpate.alignment import Aligner, AlignmentReport
from palpate.config import Pipeline
from palpate.device import is_live
from palpate.errors import DeviceError
from palpate.pipeline.data_path import DataPath
from palpate.pipeline.flow import Arrivals, Flow, Progress, Taken
from palpate.pipeline.interrupt import Interrupt
from palpate.pipeline.latency import Latency
from palpate.pipeline.outputs import Outputs
from palpate.pipeline.standstill import declared_noise
from palpate.pipeline.telling import Telling
from palpate.pipeline.tracks import Tracks


class Session:
    """Passes what the devices send along the data path, and reports progress, health and flags meanwhile.

    Sets `begun` at the first batch.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        tracks: Tracks,
        outputs: Outputs,
        interrupt: Interrupt,
        progress: Progress | None,
        begun: Event,
    ) -> None:
        live = is_live(pipeline.devices)
        self._aligner = Aligner(pipeline.alignment, pipeline.ports)
        self._latency = Latency(pipeline.ports["position"]) if live and pipeline.tracks else None
        self._path = DataPath(self._aligner, tracks, outputs, self._latency)
        self._flow = Flow(pipeline, self._take, interrupt, declared_noise(pipeline))
        self._telling = Telling(outputs.writers, self._flow, self._aligner, tracks, pipeline)
        self._interrupt, self._progress, self._begun = interrupt, progress, begun

    def run(self) -> DeviceError | None:
        """Until there are no more batches and no backlog; the failure of a device, where that ended it."""
        failure = None
        try:
            self._flow.run()
        except DeviceError as error:
            self._interrupt.reason, failure = f"stopped by a device: {error}", error
        for _ in self._path.finish(lambda: self._interrupt.reason is not None):
            self._show()
        self._telling.last({"time": self._aligner.reached, "behind": 0.0})
        return failure

    def _take(self, arrivals: Arrivals) -> Taken:
        self._begun.set()
        self._path.step(arrivals)
        return self._show()

    def _show(self) -> Taken:
        reached, behind = self._aligner.reached, self._path.backlog.behind
        self._telling.look({"time": reached, "behind": behind})
        if self._progress is not None and reached:
            self._progress(reached, self._flow.total, behind)
        return Taken(reached, behind)

    @property
    def report(self) -> AlignmentReport:
        """What the alignment found in the record."""
        return self._aligner.report

    @property
    def facts(self) -> Mapping[str, Any]:
        """What there is to say of a live run; nothing of another one."""
        if self._latency is None:
            return self._flow.facts
        backlog = self._path.backlog
        behind = {"largest_behind": backlog.largest, "until": backlog.given_up}
        return {**self._flow.facts, "estimates": {"latency": self._latency.table(), **behind}}
