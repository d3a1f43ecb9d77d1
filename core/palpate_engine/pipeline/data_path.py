"""The data path: from readings to estimates, live or replayed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from palpate.clocks import clock
from palpate.device import Batch
from palpate.estimation import Samples

from palpate_engine.alignment import Aligner
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.tracks import Tracks

# Choices.
_SLICE_DURATION = 0.05  # [s] of estimating, after which a live run records again what has come
_MIN_SLICE, _MAX_SLICE = 10, 5000  # samples
_FIRST_SLICE = 100  # samples, before it is known how long one takes
_MAX_BEHIND = 60.0  # [s] of samples; where more wait, estimating is given up: memory is limited
_COST_WEIGHT = 0.5  # of the latest slice against those before, in the cost of a sample


class Backlog:
    """Hands out samples to be estimated: all of them, or in a live run as many as take a slice of time."""

    def __init__(self, latency: Latency | None = None) -> None:
        """Take the latency of a live run, to which each slice of estimates is reported."""
        self._latency = latency  # of a live run
        self._waiting: deque[Samples] = deque()
        self._sample_cost = 0.0  # [s] of estimating; 0: not known yet
        self._slice_start = 0.0  # [s] by the clock
        self.sampled = 0.0  # [s] of the record that have become samples
        self.estimated = 0.0  # [s] of the record that have been handed out
        self.given_up: float | None = None  # [s] until when there are estimates; None: to the end
        self.largest = 0.0  # [s] that the estimates were behind at most

    @property
    def behind(self) -> float:
        """Time [s] of the record by which the estimates are behind the samples."""
        return self.sampled - self.estimated if self._waiting else 0.0

    def next(self, samples: Samples) -> Samples:
        """Take in new samples; return those that are to be estimated now."""
        if len(samples):
            self._waiting.append(samples)
            self.sampled = float(samples.time[-1])
        if self.behind > _MAX_BEHIND and self._latency:
            self.give_up()
        due = self._due() if self._waiting else samples[:0]
        if self._latency and self._waiting and len(due):  # what is handed out at once is not behind
            self.largest = max(self.largest, self.sampled - float(due.time[-1]))
        self._slice_start = clock().now()
        return due

    def _due(self) -> Samples:
        """Return the samples that wait: all of them, or in a live run a slice."""
        is_unlimited = self._latency is None or self.given_up is not None or clock().simulated
        room = _FIRST_SLICE  # samples
        if self._sample_cost:
            room = int(np.clip(_SLICE_DURATION / self._sample_cost, _MIN_SLICE, _MAX_SLICE))
        blocks: list[Samples] = []
        while self._waiting and (is_unlimited or room > 0):
            block = self._waiting.popleft()
            if not is_unlimited and len(block) > room:
                self._waiting.appendleft(block[room:])
                block = block[:room]
            blocks.append(block)
            room -= len(block)
        return Samples.joined(blocks) if len(blocks) > 1 else blocks[0]

    def served(self, samples: Samples) -> None:
        """Take note of samples that have been estimated and written, and of what one costs."""
        if not len(samples):
            return
        self.estimated = float(samples.time[-1])
        if self._latency is not None and self.given_up is None:
            cost = (clock().now() - self._slice_start) / len(samples)
            weight = _COST_WEIGHT if self._sample_cost else 1.0
            self._sample_cost += weight * (cost - self._sample_cost)
            self._latency.served(samples.stamp)

    def give_up(self) -> None:
        """Hand out samples from here on to be written, not to be estimated."""
        if self.given_up is None and self._waiting:
            self.given_up = self.estimated


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
