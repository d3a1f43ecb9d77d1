"""Tracks at work."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from palpate.config import Pipeline, Track
from palpate.errors import ConfigurationError
from palpate.estimation import Estimates, Problem, Samples, Tracker
from palpate.result import TrackRecord, timing_uncertainty


@dataclass
class RunningTrack:
    """A track at work."""

    track: Track
    tracker: Tracker
    record: TrackRecord
    waiting: list[Samples] = field(default_factory=list)  # an offline estimator wants them all at once

    def run(self, samples: Samples) -> Estimates:
        """Estimates for a block, with the time that they took."""
        before = time.perf_counter()
        estimates = self.tracker.run(samples)
        self.record.add(samples, estimates, time.perf_counter() - before)
        return estimates


def start_tracks(pipeline: Pipeline) -> list[RunningTrack]:
    """Every track with a fresh tracker; raises ConfigurationError where an estimator cannot start."""
    keep = max(3.0 * pipeline.run.average, 1.0)
    rest = pipeline.safety.rest if pipeline.safety else None
    running = []
    for track in pipeline.tracks:
        problem = Problem(track.model, pipeline.alignment.tip_mass, timing_uncertainty(pipeline.alignment), rest)
        try:
            tracker = track.estimator.start(problem)
        except ConfigurationError as error:
            raise ConfigurationError(f"{pipeline.path}: [estimator.{track.name.split('/')[-1]}]: {error}") from error
        # An offline estimate holds for all of its samples, so all of them are looked at.
        record = TrackRecord(keep if track.estimator.online else math.inf)
        running.append(RunningTrack(track, tracker, record))
    return running
