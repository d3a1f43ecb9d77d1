"""A run in progress: from the first batch to the last estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Event
from typing import TYPE_CHECKING

from palpate.device import is_live
from palpate.errors import DeviceError, UserError, error_text

from palpate_engine.alignment import AlignmentReport
from palpate_engine.config import Pipeline
from palpate_engine.pipeline.arrivals import Arrivals, Progress
from palpate_engine.pipeline.data_path import DataPath
from palpate_engine.pipeline.flow import Flow
from palpate_engine.pipeline.health import HealthReporter
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.plugin_failure import third_party_error
from palpate_engine.pipeline.run_flow import run_flow
from palpate_engine.pipeline.tracks import Tracks, declared_noise

if TYPE_CHECKING:
    from palpate_engine.pipeline.live.live_facts import LiveFacts

# Takes the time of the record [s], its duration [s] where known, and by how much the estimates are behind [s].
Observer = Callable[[float, float | None, float], None]


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
        observe: Observer | None,
        begun: Event,
    ) -> None:
        """Take a pipeline, its tracks and outputs, and the observer of its progress."""
        live = is_live(pipeline.devices)
        self._aligner = pipeline.new_aligner()
        self._latency = Latency(pipeline.ports["position"]) if live and pipeline.tracks else None
        self._path = DataPath(self._aligner, tracks, outputs, self._latency)
        self._flow = Flow(pipeline, self._take, interrupt, declared_noise(pipeline))
        self._health = HealthReporter(outputs.writers, self._flow, self._aligner, tracks, pipeline)
        self._interrupt, self._observe, self._begun, self._outputs = interrupt, observe, begun, outputs
        self._registry = pipeline.registry

    def run(self) -> Exception | None:
        """Run until no batches and no backlog remain; return what ended it early, unless that was a request to stop.

        Raises UserError where the run is refused before it begins.
        """
        failure: Exception | None = None
        for step in (partial(run_flow, self._flow), self._finish):
            try:
                step()
            except Exception as raised:
                error = third_party_error(raised, self._registry)
                if isinstance(error, UserError) and not self._begun.is_set():
                    raise error from error.__cause__
                if failure is None and self._outputs.failure is None:
                    cause = "a device" if isinstance(error, DeviceError) else "an error"
                    self._interrupt.reason = f"stopped by {cause}: {error_text(error)}"
                failure = failure or error
        return self._outputs.failure or failure

    def _finish(self) -> None:
        """Estimate the rest of the record and of the backlog."""
        for _ in self._path.finish(lambda: self._interrupt.reason is not None):
            self._report_progress()
        self._health.finish({"time": self._aligner.reached, "behind": 0.0})

    def _take(self, arrivals: Arrivals) -> Progress:
        """Take in batches from the devices; return how far the record has become samples and estimates."""
        self._begun.set()
        self._path.step(arrivals)
        return self._report_progress()

    def _report_progress(self) -> Progress:
        """Report progress to the writers of health and to the observer, and return it."""
        time, behind = self._aligner.reached, self._path.backlog.behind
        self._health.step({"time": time, "behind": behind})
        if self._observe is not None and time:
            self._observe(time, self._flow.total, behind)
        return Progress(time, behind)

    @property
    def report(self) -> AlignmentReport:
        """The facts of the record by its alignment."""
        return self._aligner.report

    @property
    def live(self) -> LiveFacts | None:
        """The facts of a live run; None for another one."""
        facts = self._flow.facts
        if facts is None or self._latency is None:
            return facts
        from palpate_engine.pipeline.live.live_facts import EstimateFacts

        backlog = self._path.backlog
        return replace(facts, estimates=EstimateFacts(self._latency.table(), backlog.largest, backlog.given_up))
