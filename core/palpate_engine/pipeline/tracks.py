"""The tracks of a run while it goes on: samples in, estimates and results out."""

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

_MIN_TRACKED = 10  # samples, up to which a running track has no result; a choice
_MIN_DEPTH = 1e-4  # [m] at which the share of a curved skin is taken at least; a choice
_MIN_BLOCK = 256  # samples that are worth a thread; a choice
_KEPT_AVERAGES = 3.0  # lengths of the average that an online track's record keeps; a choice
_MIN_KEPT = 1.0  # [s]: the same


def declared_noise(pipeline: Pipeline) -> dict[str, tuple[float, float]]:
    """Return the noise of force [N] and velocity [m/s] that estimators count on, by their names."""
    declared = {track.name.estimator: track.estimator.declared_noise for track in pipeline.tracks}
    return {name: noise for name, noise in declared.items() if noise is not None}


@dataclass
class RunningTrack:
    """A track, its tracker, and the record of what it has estimated."""

    track: Track
    tracker: Tracker
    record: TrackRecord
    part_failure: PartFailure
    is_over_a_surface: bool = False  # whose curvatures samples have
    comparison: ComparisonRecord | None = None  # of a run with several tracks

    def run(self, samples: Samples) -> Estimates:
        """Return the estimates of a block; idle ones from the block on at which the estimator or the model raised."""
        parameters = len(self.track.model.parameters)
        if self.record.failure is not None:
            return read_only(Estimates.idle(samples, parameters))
        start = clock().now()
        try:
            # The force that a flat skin would give, for the models are of one.
            share = self._curved_share(samples)
            flat = samples if share is None else read_only(replace(samples, force=samples.force / share))
            estimates = check_estimates(self.tracker.run(flat), flat, parameters)
            self.record.add(flat, estimates, clock().now() - start)
            if self.comparison is not None:
                self.comparison.add(flat, estimates)
        except PalpateError:
            raise  # on purpose: the user can mend it
        except RAISED_BY_PARTS as error:  # whatever third-party code raises: the other tracks continue
            self.record.failure = self.part_failure.flag(error, samples)
            return read_only(Estimates.idle(samples, parameters))
        return estimates if share is None else read_only(replace(estimates, force=estimates.force * share))

    def _curved_share(self, samples: Samples) -> Floats | None:
        """Return the force (n,) on the curved skin over that on a flat one; 1 where unknown, None where 1 throughout.

        The inertia of the tip is divided by it, too: a share of a few per cent of a force that is a hundredth.
        """
        if not self.is_over_a_surface:
            return None
        is_known = np.isfinite(samples.curvature[:, 0]) & np.isfinite(samples.curvature[:, 1])
        curvature = np.where(is_known[:, None], samples.curvature, 0.0)
        share = self.track.model.curved_share(curvature, np.maximum(-samples.position, _MIN_DEPTH))
        return None if share is None else np.where(is_known, share, 1.0)

    def result(self, report: AlignmentReport, settings: AlignmentSettings, average: float) -> TrackResult:
        """Return the result of the track at the end of its record."""
        track, online = self.track, self.track.estimator.online
        try:
            return track_result(track.name, track.model, self.record, report, settings, average, online)
        except PalpateError:
            raise
        except RAISED_BY_PARTS as error:  # a model that cannot say what its parameters mean
            self.record.failure = self.part_failure.flag(error)
            return track_result(track.name, track.model, self.record, report, settings, average, online)

    def so_far(self, report: AlignmentReport, settings: AlignmentSettings, average: float) -> TrackResult | None:
        """Return the result of the track if the run ended now; None with too few samples, or where the model fails."""
        if self.record.samples <= _MIN_TRACKED and self.record.failure is None:
            return None
        try:
            return track_result(self.track.name, self.track.model, self.record, report, settings, average, online=True)
        except RAISED_BY_PARTS:  # a model that fails here fails in the result, too, which reports it
            return None


class Tracks:
    """All tracks of a run: samples in, estimates out."""

    def __init__(self, running: Sequence[RunningTrack], threads: ThreadPoolExecutor | None = None) -> None:
        self.running = tuple(running)
        self._threads = threads  # run the online tracks but the first, where nobody waits for single samples
        self.online = tuple(track for track in running if track.track.estimator.online)
        self._offline = tuple(track for track in running if not track.track.estimator.online)
        self._blocks: list[Samples] = []  # of the whole record, for the offline estimators

    def estimate(self, samples: Samples) -> dict[str, Estimates]:
        """Return the estimates of a block by the online estimators, by track."""
        if not len(samples):
            return {}
        if self._offline:
            self._blocks.append(samples)
        if self._threads is None or len(samples) < _MIN_BLOCK or len(self.online) < 2:
            return {track.track.name: track.run(samples) for track in self.online}
        # The first one in this thread, and the others in threads of their own.
        first_track, *parallel_tracks = self.online
        futures = [self._threads.submit(track.run, samples) for track in parallel_tracks]
        try:
            estimates: dict[str, Estimates] = {first_track.track.name: first_track.run(samples)}
        finally:
            wait(futures)
        return estimates | {
            track.track.name: future.result() for track, future in zip(parallel_tracks, futures, strict=True)
        }

    def estimate_offline(self) -> tuple[Samples, dict[str, Estimates]] | None:
        """Return all samples and their estimates by the offline estimators, by track; None if the run has none."""
        if not self._blocks:
            return None
        samples, self._blocks = Samples.joined(self._blocks), []
        return samples, {track.track.name: track.run(samples) for track in self._offline}

    def results(self, pipeline: Pipeline, report: AlignmentReport, detail: bool = True) -> dict[str, TrackResult]:
        """Return the results of all tracks with the findings of diagnoses; without `detail` not those of details."""
        settings, average = pipeline.alignment, pipeline.run.average
        results: dict[str, TrackResult] = {
            running.track.name: running.result(report, settings, average) for running in self.running
        }
        registered = pipeline.registry.diagnoses
        diagnoses = {name: diagnosis for name, diagnosis in registered.items() if detail or not diagnosis.detail}
        results = self._diagnose(results, pipeline, report, diagnoses)
        for running in self.running:
            name = running.track.name
            results[name] = _compare(running, _summarise(running, results[name]), settings.tip_mass, average)
        return results

    def results_so_far(self, pipeline: Pipeline, report: AlignmentReport) -> dict[str, TrackResult]:
        """Return the results of the online tracks if the run ended now, with the findings of quick diagnoses."""
        settings, average = pipeline.alignment, pipeline.run.average
        results: dict[str, TrackResult] = {}
        for running in self.online:
            result = running.so_far(report, settings, average)
            if result is not None:
                results[running.track.name] = result
        quick = {name: diagnosis for name, diagnosis in pipeline.registry.diagnoses.items() if diagnosis.quick}
        return self._diagnose(results, pipeline, report, quick)

    def _diagnose(
        self,
        results: Mapping[str, TrackResult],
        pipeline: Pipeline,
        report: AlignmentReport,
        diagnoses: Mapping[str, Diagnosis],
    ) -> dict[str, TrackResult]:
        """Return results with the findings of diagnoses, but for those of tracks that failed."""
        diagnosable: dict[str, Diagnosable] = {}
        for running in self.running:
            track, record = running.track, running.record
            if track.name in results and record.failure is None:
                diagnosable[track.name] = Diagnosable(track.model, track.estimator, record, results[track.name])
        run = pipeline.run
        is_simulated = run.rehearsal is not None or any(device.simulated for device in pipeline.devices.values())
        evidence = RunEvidence(
            settings=pipeline.alignment,
            report=report,
            average=run.average,
            uncertainties=run.uncertainties,
            tables=pipeline.tables,
            is_simulated=is_simulated,
        )
        return {**results, **apply_diagnoses(diagnosable, diagnoses, evidence)}


def _summarise(running: RunningTrack, result: TrackResult) -> TrackResult:
    """Return a track's result with its summaries; as it is where the track failed."""
    for summary in running.record.summaries.values() if running.record.failure is None else ():
        result = summary.of(result, running.track.model, running.record.is_sweep)
    return result


def _compare(running: RunningTrack, result: TrackResult, tip_mass: float | None, average: float) -> TrackResult:
    """Return a track's result with the measures by which it is compared with others; as it is without others."""
    if running.comparison is None:
        return result
    ends = running.record.ends(average)
    nis_count = 0 if ends is None else int(np.count_nonzero(np.isfinite(ends[1].nis)))
    measures = running.comparison.measure(running.track.model, tip_mass or 0.0, result.parameters, nis_count)
    return replace(result, comparison=measures)


def _other_parameters(pipeline: Pipeline, model: str) -> dict[str, tuple[str, ...]]:
    """Return the names of the parameters of the other models, by model."""
    models = {name: other for name, other in pipeline.models.items() if name != model}
    return {name: tuple(parameter.name for parameter in other.parameters) for name, other in models.items()}


def start_tracks(pipeline: Pipeline, compares: bool | None = None) -> list[RunningTrack]:
    """Return every track with a fresh tracker, and a record of its samples and estimates.

    With `compares` each also keeps what tracks are compared by; if that is None, where there are several. Raises
    ConfigurationError where an estimator cannot start.
    """
    kept = max(_KEPT_AVERAGES * pipeline.run.average, _MIN_KEPT)  # [s]
    is_over_a_surface = pipeline.alignment.surface is not None
    is_compared = len(pipeline.tracks) > 1 if compares is None else compares
    running = []
    for track in pipeline.tracks:
        part_failure = PartFailure(track, pipeline.registry)
        tracker = _start_tracker(pipeline, track, part_failure)
        summaries = {name: function_of(summary)() for name, summary in pipeline.registry.summaries.items()}
        # An offline estimate holds for all of its samples, so all of them are kept.
        record = TrackRecord(kept if track.estimator.online else math.inf, summaries=summaries)
        comparison = ComparisonRecord() if is_compared else None
        running.append(RunningTrack(track, tracker, record, part_failure, is_over_a_surface, comparison))
    return running


def _start_tracker(pipeline: Pipeline, track: Track, part_failure: PartFailure) -> Tracker:
    """Return the tracker of a track; raises ConfigurationError where the estimator refuses, PluginError where it
    fails."""
    settings = pipeline.alignment
    problem = Problem(
        model=track.model,
        tip_mass=settings.tip_mass,
        timing_uncertainty=settings.timing_uncertainty,
        standstill=pipeline.safety.standstill if pipeline.safety else None,
        others=_other_parameters(pipeline, track.name.model),
        zero_uncertainty=settings.zero_uncertainty,
        force_zero=settings.force_zero,
    )
    try:
        return track.estimator.start(problem)
    except ConfigurationError as error:
        raise ConfigurationError(f"{pipeline.path}: [estimator.{track.name.estimator}]: {error}") from error
    except PalpateError:
        raise
    except RAISED_BY_PARTS as error:  # whatever third-party code raises
        raise PluginError(f"{pipeline.path}: track {track.name}: {part_failure.complaint(error)}") from error
