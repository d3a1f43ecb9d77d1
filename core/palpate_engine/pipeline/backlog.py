"""The backlog: samples that wait for their estimates, and how late these are."""

from __future__ import annotations

from collections import deque

import numpy as np
from palpate.clocks import clock
from palpate.estimation import Samples

from palpate_engine.pipeline.latency import Latency

_SLICE = 0.05  # [s] of estimating, after which a live run records again what has come
_LEAST, _MOST = 10, 5000  # samples in a slice
_LONGEST = 60.0  # [s] of samples; where more wait, estimating is given up: memory is limited
_NEWEST = 0.5  # of the pace: the latest slice against those before


class Backlog:
    """Hands out samples to be estimated: all of them, or in a live run as many as take a slice of time."""

    def __init__(self, latency: Latency | None = None) -> None:
        self._latency = latency  # of a live run
        self._waiting: deque[Samples] = deque()
        self._seconds = 0.0  # that a sample takes
        self._began = 0.0
        self.sampled = 0.0  # [s] of the record that have become samples
        self.estimated = 0.0  # [s] of the record that have been handed out
        self.given_up: float | None = None  # [s] until when there are estimates; None: to the end
        self.largest = 0.0  # [s] that the estimates were behind at most

    @property
    def behind(self) -> float:
        """How far [s] the estimates are behind the samples."""
        return self.sampled - self.estimated if self._waiting else 0.0

    def next(self, samples: Samples) -> Samples:
        """Take in new samples; those that are due."""
        if len(samples):
            self._waiting.append(samples)
            self.sampled = float(samples.time[-1])
        if self.behind > _LONGEST and self._latency:
            self.give_up()
        due = self._due(samples[:0])
        if self._latency and self._waiting and len(due):  # what is handed out at once is not behind
            self.largest = max(self.largest, self.sampled - float(due.time[-1]))
        self._began = clock().now()
        return due

    def _due(self, none: Samples) -> Samples:
        if not self._waiting:
            return none
        everything = self._latency is None or self.given_up is not None or clock().simulated
        room = int(np.clip(_SLICE / self._seconds, _LEAST, _MOST)) if self._seconds else 10 * _LEAST
        taken = []
        while self._waiting and (everything or room > 0):
            block = self._waiting.popleft()
            if not everything and len(block) > room:
                self._waiting.appendleft(block[room:])
                block = block[:room]
            taken.append(block)
            room -= len(block)
        return Samples.joined(taken) if len(taken) > 1 else taken[0]

    def served(self, samples: Samples) -> None:
        """Samples have been estimated and written."""
        if not len(samples):
            return
        self.estimated = float(samples.time[-1])
        if self._latency is not None and self.given_up is None:
            now = (clock().now() - self._began) / len(samples)
            self._seconds += (_NEWEST if self._seconds else 1.0) * (now - self._seconds)
            self._latency.served(samples.stamp)

    def give_up(self) -> None:
        """From here on samples are handed out to be written, not to be estimated."""
        if self.given_up is None and self._waiting:
            self.given_up = self.estimated
