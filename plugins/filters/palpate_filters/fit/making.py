"""Fits of whole logs: here one after the other, or side by side on the workers of a scheduler."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from palpate import Batch, Estimates, LogError, Samples, UserError
from palpate.host import (
    Answer,
    ClusterRun,
    Pipeline,
    Result,
    TrackResult,
    cluster_results,
    found_before,
    keep,
    progress,
    progressed,
    run_pipeline,
    unused,
)


@dataclass
class KeptRun:
    """A writer that keeps samples and offline estimates in memory, for tables and pictures."""

    blocks: list[Samples] = field(default_factory=list)
    found: dict[str, Estimates] = field(default_factory=dict)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep the estimates of a track."""
        self.found[track] = estimates


@dataclass(frozen=True)
class LogFit:
    """One log with the fits of every track."""

    name: str
    pipeline: Pipeline
    result: Result
    samples: Samples

    @property
    def fitted(self) -> dict[str, TrackResult]:
        """Tracks whose fit succeeded."""
        return {name: track for name, track in self.result.tracks.items() if track.report is not None}


def fits_of(
    loaded: Sequence[tuple[str, Pipeline]], folder: Path, scheduler: str | None, stage: str | None, pictures: bool
) -> Iterator[tuple[str, LogFit | UserError]]:
    """What every log gives, as it is ready: in their order here, in any order on the workers of a scheduler."""
    runs = [ClusterRun(name, pipeline, folder / name) for name, pipeline in loaded]
    work = partial(fit_or_find, pictures=pictures)
    if scheduler is not None:
        with closing(cluster_results(scheduler, folder, runs, stage, work)) as found:
            for run, outcome in found:
                yield run.name, outcome if isinstance(outcome, UserError) else _log_fit(run, outcome)
        return
    for run in runs:
        try:
            yield run.name, _log_fit(run, work(run))
        except UserError as error:
            yield run.name, error


def _log_fit(run: ClusterRun, answer: Answer) -> LogFit:
    return LogFit(run.name, run.pipeline, answer.result, answer.more)


def fit_or_find(run: ClusterRun, pictures: bool) -> Answer:
    """The fits of a log with its samples; found where an earlier attempt has made them. Raises UserError."""
    if (found := found_before(run)) is not None:
        return Answer(found, _samples(run))
    kept = KeptRun()
    with progress(run.name, "s"):
        result = run_pipeline(run.pipeline, unused(run.folder), progressed, kept)
    result.demand_whole()
    samples = _joined(run, kept.blocks)
    if pictures:
        from palpate_filters.fit.pictures import draw

        draw(samples, kept.found, run.pipeline.alignment.tip_mass or 0.0, result.folder)
    keep(result)
    return Answer(result, samples)


def _samples(run: ClusterRun) -> Samples:
    """The samples of a log, without any estimates."""
    kept = KeptRun()
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, progress(run.name, "s"):
        reading = replace(run.pipeline, tracks=(), sinks={})
        run_pipeline(reading, Path(folder, "run"), progressed, kept).demand_whole()
    return _joined(run, kept.blocks)


def _joined(run: ClusterRun, blocks: Sequence[Samples]) -> Samples:
    if not blocks:
        raise LogError(f"{run.name}: the log holds no samples")
    return Samples.joined(blocks)
