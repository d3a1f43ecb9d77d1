"""Fits of whole logs: here one after the other, or side by side on the workers of a scheduler."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from palpate import LogError, PalpateError, Samples, UserError
from palpate_engine import Pipeline, Result, TrackResult, run_pipeline
from palpate_kit.jobs.cluster import on_cluster
from palpate_kit.jobs.job import Job, Outcome, RunAnswer, cached_result, unused_folder
from palpate_kit.jobs.result_cache import write_cache
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.progress import progress, report_progress


@dataclass(frozen=True)
class LogFit:
    """One log with the fits of every track."""

    name: str
    pipeline: Pipeline
    result: Result
    samples: Samples

    @property
    def fitted(self) -> dict[str, TrackResult]:
        """The tracks whose fit succeeded."""
        return {name: track for name, track in self.result.tracks.items() if track.report is not None}


def fits_of(
    loaded: Sequence[tuple[str, Pipeline]], folder: Path, scheduler: str | None, stage: str | None, pictures: bool
) -> Iterator[tuple[str, LogFit | PalpateError]]:
    """Yield the fit of every log, or its error, by the log's name.

    In the order of the logs; on the workers of a scheduler as each is ready.
    """
    work = partial(fit_or_find, pictures=pictures)
    jobs = {name: Job(name, pipeline, folder / name, work) for name, pipeline in loaded}
    pipelines = dict(loaded)
    if scheduler is not None:
        with closing(on_cluster(scheduler, folder, stage)([*jobs.values()])) as outcomes:
            for job, outcome in outcomes:
                yield job.name, _log_fit(job.name, pipelines[job.name], outcome)
        return
    for name, job in jobs.items():
        try:
            yield name, _log_fit(name, pipelines[name], work(job))
        except UserError as error:
            yield name, error


def _log_fit(name: str, pipeline: Pipeline, outcome: Outcome) -> LogFit | PalpateError:
    """Return the outcome of a job as a fit, or its error."""
    return outcome if isinstance(outcome, PalpateError) else LogFit(name, pipeline, outcome.result, outcome.more)


def fit_or_find(job: Job, pictures: bool) -> RunAnswer:
    """Return the fits of a log with its samples, those of an earlier attempt if there was one. Raises UserError."""
    pipeline = job.pipeline()
    if (cached := cached_result(job)) is not None:
        return RunAnswer(cached, _samples(job.name, pipeline))
    observer = SampleObserver()
    with progress(job.name, "s"):
        result = run_pipeline(pipeline, unused_folder(job.folder), report_progress, observer)
    result.demand_whole()
    samples = _joined(job.name, observer.blocks)
    if pictures:
        from palpate_fits.fit_figures import draw

        draw(samples, observer.found, pipeline.alignment.tip_mass or 0.0, result.folder)
    write_cache(result)
    return RunAnswer(result, samples)


def _samples(name: str, pipeline: Pipeline) -> Samples:
    """Return the samples of a log, without any estimates."""
    observer = SampleObserver()
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, progress(name, "s"):
        reading = replace(pipeline, tracks=(), sinks={})
        run_pipeline(reading, Path(folder, "run"), report_progress, observer).demand_whole()
    return _joined(name, observer.blocks)


def _joined(name: str, blocks: Sequence[Samples]) -> Samples:
    """Return blocks as one; raises LogError without any."""
    if not blocks:
        raise LogError(f"{name}: the log holds no samples")
    return Samples.joined(blocks)
