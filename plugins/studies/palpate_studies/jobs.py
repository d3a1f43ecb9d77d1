"""Runs as plain data, and the engine of this machine."""

from __future__ import annotations

import itertools
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import OutputError, PalpateError
from palpate.host import Pipeline, RunFolder, Source, build_pipeline, resolved_text, run_pipeline

from palpate_studies.differing import differences

_DEATHS = 3  # processes that a job may take with it


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
    """What an earlier, interrupted sweep found for a combination; None where it did not get that far.

    Raises OutputError where that was with other settings than the job has now.
    """
    for path in sorted(Path(job.folder).glob(f"{job.number:05d}*")):
        run = RunFolder(path)
        if not run.finished:
            continue
        result = run.result
        if not any(flag["code"] == "interrupted" for track in result["tracks"].values() for flag in track["flags"]):
            demand_same(built(job), run, f"combination {job.number}")
            return result
    return None


def demand_same(pipeline: Pipeline, run: RunFolder, name: str) -> None:
    """Raise OutputError where a run was made with other settings than a pipeline has now; `name` says what it is."""
    told = differences(resolved_text(pipeline), run.pipeline.read_text(encoding="utf-8"), pipeline.registry.tables)
    if told:
        raise OutputError(
            f"{run.path}: {name} was run with other settings: {told}; nothing is mixed: give --out another folder, or "
            "the settings of then"
        )


def on_all_cores(jobs: Sequence[Job], workers: int | None = None) -> Generator[tuple[Job, dict[str, Any]]]:
    """The engine of this machine: as many processes as cores.

    Where a process is killed, as the kernel does when memory is short, what is unfinished is run again in fresh ones:
    jobs that ran beside it one by one, so that the one that kills its process is known and given up after three.
    """
    count = min(workers or len(os.sched_getaffinity(0)), len(jobs))
    if count <= 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    left: deque[Job] = deque(jobs)
    suspects: deque[tuple[Job, int]] = deque()  # and how many processes died while each ran
    while left or suspects:
        if left:
            suspects.extend([(job, 1) for job in (yield from _pooled(left, count))])
            continue
        job, deaths = suspects.popleft()
        if (found := finished(job)) is not None:  # it was done, only its answer was lost
            yield job, found
        elif (yield from _pooled(deque([job]), 1)):
            if deaths + 1 < _DEATHS:
                suspects.append((job, deaths + 1))
            else:
                reason = f"its process was killed {_DEATHS} times: is the memory enough?"
                yield job, {"error": f"lost: {reason}"}


def _pooled(left: deque[Job], count: int) -> Generator[tuple[Job, dict[str, Any]], None, list[Job]]:
    """Run what is left, in so many processes, until one of them dies; the jobs that were running then."""
    context = multiprocessing.get_context("spawn")  # forking a process with threads is asking for trouble
    running: dict[Future[dict[str, Any]], Job] = {}
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        try:
            while left or running:
                while left and len(running) < count:
                    running[pool.submit(run_job, left[0])] = left[0]
                    left.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        continue
                    job = running.pop(future)
                    yield job, future.result() if error is None else {"error": f"lost: {error}"}
                if any(future.done() for future in running):
                    break
        except BrokenProcessPool:
            pass  # it died before it was given anything more
        finally:
            pool.shutdown(cancel_futures=True)
    return list(running.values())
