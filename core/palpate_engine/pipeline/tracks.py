"""Tracks at work."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace

import numpy as np
from palpate.clocks import clock
from palpate.errors import RAISED_BY_PARTS, ConfigurationError, PalpateError, PluginError
from palpate.estimation import Estimates, Problem, Samples, Tracker
from palpate.offers import Diagnosis, function_of
from palpate.vectors import Floats, read_only

from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.config import Pipeline, Track
from palpate_engine.pipeline.plugin_failure import PartFailure, check_estimates
from palpate_engine.result import (
    ComparisonRecord,
    Diagnosable,
    RunEvidence,
    TrackRecord,
    TrackResult,
    apply_diagnoses,
    track_result,
)

_FEW = 10  # tracked samples; before that nothing is said of a track
_SHALLOW = 1e-4  # [m] at which, or deeper, the share of a curved skin is taken
_MANY = 256  # samples of a block that are worth a thread


def declared_noise(pipeline: Pipeline) -> dict[str, tuple[float, float]]:
    """Return the noise of force [N] and velocity [m/s] that estimators count on, by their names."""
    declared = {track.name.estimator: track.estimator.declared_noise for track in pipeline.tracks}
    return {name: noise for name, noise in declared.items() if noise is not None}


@dataclass
class RunningTrack:
    """A track at work."""

    track: Track
    tracker: Tracker
    record: TrackRecord
    part_failure: PartFailure
    is_over_a_surface: bool = False  # whose curvatures samples have
    comparison: ComparisonRecord | None = None  # of a run with several tracks

    def run(self, samples: Samples) -> Estimates:
        """Estimates for a block, with the time that they took; none from where the estimator or the model raised."""
        parameters = len(self.track.model.parameters)
        if self.record.failure is not None:
            return read_only(Estimates.idle(samples, parameters))
        before = clock().now()
        try:
            share = self._curved_share(samples)
            flat = samples if share is None else read_only(replace(samples, force=samples.force / share))
            estimates = check_estimates(self.tracker.run(flat), flat, parameters)
            self.record.add(flat, estimates, clock().now() - before)
            if self.comparison is not None:
                self.comparison.add(flat, estimates)
        except PalpateError:
            raise  # on purpose: the user can mend it
        except RAISED_BY_PARTS as error:  # whatever third-party code raises: the other tracks continue
            self.record.failure = self.part_failure.flag(error, samples)
            return read_only(Estimates.idle(samples, parameters))
        return estimates if share is None else read_only(replace(estimates, force=estimates.force * share))

    def _curved_share(self, samples: Samples) -> Floats | None:
        """Force (n,) on the skin as it is curved over that on a flat one; 1 where that is unknown, None where always.

        The inertia of the tip is divided by it, too: a share of a few per cent of a force that is a hundredth.
        """
        if not self.is_over_a_surface:
            return None
        known = np.isfinite(samples.curvature[:, 0]) & np.isfinite(samples.curvature[:, 1])
        curvature = np.where(known[:, None], samples.curvature, 0.0)
        share = self.track.model.curved_share(curvature, np.maximum(-samples.position, _SHALLOW))
        return None if share is None else np.where(known, share, 1.0)

    def result(self, report: AlignmentReport, settings: AlignmentSettings, average: float) -> TrackResult:
        """What the track found."""
        track, online = self.track, self.track.estimator.online
        try:
            return track_result(track.name, track.model, self.record, report, settings, average, online)
        except PalpateError:
            raise
        except RAISED_BY_PARTS as error:  # a model that cannot say what its parameters mean
            self.record.failure = self.part_failure.flag(error)
            return track_result(track.name, track.model, self.record, report, settings, average, online)

    def so_far(self, report: AlignmentReport, settings: AlignmentSettings, average: float) -> TrackResult | None:
        """What the track would find if the run ended now; None where that is not known yet."""
        if self.record.samples <= _FEW and self.record.failure is None:
            return None
        try:
            return track_result(self.track.name, self.track.model, self.record, report, settings, average, True)
        except RAISED_BY_PARTS:  # a model that fails here fails in the result, too, which reports it
            return None


class Tracks:
    """All tracks of a run: samples in, estimates out."""

    def __init__(self, running: Sequence[RunningTrack], beside: ThreadPoolExecutor | None = None) -> None:
        self.running = tuple(running)
        self._beside = beside  # runs the online tracks but the first, where nobody waits for single samples
        self.online = tuple(track for track in running if track.track.estimator.online)
        self._offline = tuple(track for track in running if not track.track.estimator.online)
        self._waiting: list[Samples] = []  # an offline estimator needs them all at once

    def estimate(self, samples: Samples) -> dict[str, Estimates]:
        """What the online estimators say of a block, by track."""
        if not len(samples):
            return {}
        if self._offline:
            self._waiting.append(samples)
        if self._beside is None or len(samples) < _MANY or len(self.online) < 2:
            return {track.track.name: track.run(samples) for track in self.online}
        first, *others = self.online
        running = [self._beside.submit(track.run, samples) for track in others]
        try:
            found: dict[str, Estimates] = {first.track.name: first.run(samples)}
        finally:
            wait(running)
        return found | {track.track.name: one.result() for track, one in zip(others, running, strict=True)}

    def estimate_offline(self) -> tuple[Samples, dict[str, Estimates]] | None:
        """Return all samples, and what the offline estimators say of them; None if the run has none."""
        if not self._waiting:
            return None
        samples, self._waiting = Samples.joined(self._waiting), []
        return samples, {track.track.name: track.run(samples) for track in self._offline}

    def results(self, pipeline: Pipeline, report: AlignmentReport, detail: bool = True) -> dict[str, TrackResult]:
        """Return what all tracks found, with the findings of every diagnosis, or of all but those of details."""
        settings, average = pipeline.alignment, pipeline.run.average
        found: dict[str, TrackResult] = {r.track.name: r.result(report, settings, average) for r in self.running}
        diagnoses = {name: one for name, one in pipeline.registry.diagnoses.items() if detail or not one.detail}
        judged = self._diagnosed(found, pipeline, report, diagnoses)
        return {
            r.track.name: _compared(r, _summed(r, judged[r.track.name]), settings.tip_mass, average)
            for r in self.running
        }

    def results_so_far(self, pipeline: Pipeline, report: AlignmentReport) -> dict[str, TrackResult]:
        """What the online tracks would find if the run ended now, with the findings of quick diagnoses."""
        settings, average = pipeline.alignment, pipeline.run.average
        every = {running.track.name: running.so_far(report, settings, average) for running in self.online}
        found: dict[str, TrackResult] = {name: result for name, result in every.items() if result is not None}
        quick = {name: diagnosis for name, diagnosis in pipeline.registry.diagnoses.items() if diagnosis.quick}
        return self._diagnosed(found, pipeline, report, quick)

    def _diagnosed(
        self,
        found: Mapping[str, TrackResult],
        pipeline: Pipeline,
        report: AlignmentReport,
        diagnoses: Mapping[str, Diagnosis],
    ) -> dict[str, TrackResult]:
        whole: dict[str, Diagnosable] = {
            r.track.name: Diagnosable(r.track.model, r.track.estimator, r.record, found[r.track.name])
            for r in self.running
            if r.track.name in found and r.record.failure is None
        }
        run = pipeline.run
        is_simulated = run.rehearsal is not None or any(device.simulated for device in pipeline.devices.values())
        return {
            **found,
            **apply_diagnoses(
                whole,
                diagnoses,
                RunEvidence(pipeline.alignment, report, run.average, run.uncertainties, pipeline.tables, is_simulated),
            ),
        }


def _summed(running: RunningTrack, result: TrackResult) -> TrackResult:
    """What summaries make of a track's result."""
    for summary in running.record.summaries.values() if running.record.failure is None else ():
        result = summary.of(result, running.track.model, running.record.is_sweep)
    return result


def _compared(running: RunningTrack, result: TrackResult, tip_mass: float | None, average: float) -> TrackResult:
    """Return a track's result with the measures by which it is compared with others."""
    ends = running.record.ends(average)
    if running.comparison is None:
        return result
    count = 0 if ends is None else int(np.count_nonzero(np.isfinite(ends[1].nis)))
    measures = running.comparison.measure(running.track.model, tip_mass or 0.0, result.parameters, count)
    return replace(result, comparison=measures)


def _others(pipeline: Pipeline, model: str) -> dict[str, tuple[str, ...]]:
    """Names of the parameters of the other models."""
    others = {name: other for name, other in pipeline.models.items() if name != model}
    return {name: tuple(parameter.name for parameter in other.parameters) for name, other in others.items()}


def start_tracks(pipeline: Pipeline, compares: bool | None = None) -> list[RunningTrack]:
    """Return every track with a fresh tracker, with what compares them (of several, if not stated).

    Raises ConfigurationError where an estimator cannot start.
    """
    keep = max(3.0 * pipeline.run.average, 1.0)
    standstill = pipeline.safety.standstill if pipeline.safety else None
    running = []
    for track in pipeline.tracks:
        part_failure = PartFailure(track, pipeline.registry)
        settings = pipeline.alignment
        others = _others(pipeline, track.name.model)
        problem = Problem(
            track.model, settings.tip_mass, settings.timing_uncertainty, standstill, others,
            settings.zero_uncertainty, settings.force_zero,
        )  # fmt: skip
        try:
            tracker = track.estimator.start(problem)
        except ConfigurationError as error:
            raise ConfigurationError(f"{pipeline.path}: [estimator.{track.name.estimator}]: {error}") from error
        except PalpateError:
            raise
        except RAISED_BY_PARTS as error:  # whatever third-party code raises
            raise PluginError(f"{pipeline.path}: track {track.name}: {part_failure.complaint(error)}") from error
        # An offline estimate holds for all of its samples, so all of them are looked at.
        summaries = {name: function_of(summary)() for name, summary in pipeline.registry.summaries.items()}
        record = TrackRecord(keep if track.estimator.online else math.inf, summaries=summaries)
        curved = pipeline.alignment.surface is not None
        is_compared = len(pipeline.tracks) > 1 if compares is None else compares
        comparison = ComparisonRecord() if is_compared else None
        running.append(RunningTrack(track, tracker, record, part_failure, curved, comparison))
    return running
