"""Runs as plain data, and the engine of this machine."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.config import Pipeline, Source, build_pipeline
from palpate.errors import PalpateError
from palpate.pipeline import run_pipeline


@dataclass(frozen=True)
class Job:
    """One combination, as plain data that any engine can send anywhere."""

    number: int
    text: str  # of the pipeline file
    path: str  # where the file stands: what is relative in it is relative to here
    overrides: tuple[str, ...]  # "table.key=value"
    values: dict[str, Any]  # what is swept
    folder: str  # in which the run makes its own


Engine = Callable[[Sequence[Job]], Generator[tuple[Job, dict[str, Any]]]]  # results in any order


def built(job: Job) -> Pipeline:
    """The pipeline of a job; raises UserError where it has a mistake."""
    source = Source(job.text, Path(job.path))
    for assignment in job.overrides:
        source.override(assignment)
    return build_pipeline(source)


def run_job(job: Job) -> dict[str, Any]:
    """Run one combination; its ``result.json``, or ``{"error": reason}``. For any process on any machine.

    ``{"interrupted": reason}`` where somebody stopped it: what was found until then is no result of the combination.
    """
    try:
        done = run_pipeline(built(job), _free(job))
        return done.table() if done.interrupted is None else {"interrupted": done.interrupted}
    except PalpateError as error:
        return {"error": str(error)}
    except Exception as error:  # one broken plugin must not end a night's sweep
        return {"error": f"{type(error).__name__}: {error}"}


def _free(job: Job) -> Path:
    """A folder that no earlier attempt has used."""
    for attempt in itertools.count(1):
        folder = Path(job.folder) / (f"{job.number:05d}" if attempt == 1 else f"{job.number:05d}-{attempt}")
        if not folder.exists():
            return folder
    raise AssertionError


def finished(job: Job) -> dict[str, Any] | None:
    """What an earlier, interrupted sweep found for a combination; None where it did not get that far."""
    for path in sorted(Path(job.folder).glob(f"{job.number:05d}*/result.json")):
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not any("interrupted:" in flag for track in result["tracks"].values() for flag in track["flags"]):
            return result
    return None


def on_all_cores(jobs: Sequence[Job], workers: int | None = None) -> Generator[tuple[Job, dict[str, Any]]]:
    """The engine of this machine: as many processes as cores."""
    count = min(workers or len(os.sched_getaffinity(0)), len(jobs))
    if count <= 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    context = multiprocessing.get_context("spawn")  # forking a process with threads is asking for trouble
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        running = {pool.submit(run_job, job): job for job in jobs}
        try:
            for future in as_completed(running):
                error = future.exception()
                yield running[future], future.result() if error is None else {"error": f"lost: {error}"}
        finally:
            pool.shutdown(cancel_futures=True)
