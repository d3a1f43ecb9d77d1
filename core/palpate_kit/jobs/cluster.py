"""Jobs on many machines: what `dask.distributed` runs, wherever its scheduler is."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from palpate import ConfigurationError, UserError
from palpate_engine import write_whole

from palpate_kit.jobs.job import Engine, Job, Outcome, Parcel, run_parcel
from palpate_kit.jobs.workers import GO_ON, Watch, demand_alike, provenance

_AHEAD = 2  # jobs that a worker holds, so that it never waits for the scheduler
Task = TypeVar("Task")
_PATIENCE = "10s"  # for a scheduler to answer: a choice
_LOOK = 0.01  # [s] between looks at what is done: a choice
_GATHER = 120.0  # [s] for a result to come here from its worker; then it is asked for again


def on_cluster(address: str, folder: Path, stage: str | None = None) -> Engine:
    """Return the engine of a scheduler at an address such as ``tcp://10.0.0.5:8786``, for jobs whose runs go into a
    folder.

    The folder is one that all workers see, or, with a `stage`, inputs and runs pass through that place. Where a worker
    is killed its jobs go to others, and one that has killed three is given up. Raises ConfigurationError where nobody
    answers, or where the workers are not what is here.
    """

    def engine(jobs: Sequence[Job]) -> Generator[tuple[Job, Outcome]]:
        with connect_scheduler(address, folder, shared=stage is None) as client:
            placed_jobs = {job.name: job.placed() for job in jobs}
            outcomes = _spread(client, placed_jobs, stage)
            with closing(outcomes):
                for name, outcome in outcomes:
                    yield placed_jobs[name], outcome

    return engine


def _spread(client: Any, jobs: Mapping[str, Job], url: str | None) -> Generator[tuple[str, Outcome]]:
    """Run jobs, by their names, on the workers; yield name and outcome of each once its run folder is here.

    The `url` of a stage is the place through which inputs and runs pass; None where workers see the folder.
    """
    parcels = (Parcel.of(job) for job in jobs.values())
    if url is None:
        yield from (
            (parcel.name, _outcome_of_answer(outcome)) for parcel, outcome in spread(client, run_parcel, parcels)
        )
        return
    from palpate_kit.jobs.staging import Stage, StagedJob, brought, run_staged

    stage = Stage(url)
    inputs = stage.put_inputs(pipeline for job in jobs.values() for pipeline in job.pipelines())
    done = spread(client, run_staged, (StagedJob(parcel, stage, inputs) for parcel in parcels))
    with closing(done):
        for staged, outcome in done:
            yield staged.name, brought(jobs[staged.name], stage, _outcome_of_answer(outcome))


def _outcome_of_answer(outcome: Any) -> Outcome:
    """Return what came back from a worker; anything but an answer to its task is the reason that none came."""
    return outcome if isinstance(outcome, Outcome) else UserError(loss_reason(outcome))


def _distributed() -> Any:
    """Return the package; raises ConfigurationError where it is not installed."""
    try:
        import distributed
    except ImportError:
        raise ConfigurationError('--scheduler needs dask.distributed; pip install "palpate[cluster]"') from None
    return distributed


@contextmanager
def connect_scheduler(address: str, folder: Path, shared: bool = True) -> Iterator[Any]:
    """Yield a client of a scheduler whose workers are as here and see the folder, where it is to be shared."""
    try:
        client = _distributed().Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigurationError(f"--scheduler {address}: no scheduler answers there: {error}") from error
    with client:
        workers = demand_alike(client, address)
        if shared:
            _demand_shared(client, folder)
        write_whole(folder / "workers.json", json.dumps(provenance(address, workers), indent=2) + "\n")
        yield client


def spread(client: Any, function: Callable[[Task], Any], tasks: Iterable[Task]) -> Generator[tuple[Task, Any]]:
    """Call a function on the workers for every task, and yield each task with its result, in any order.

    The result is an exception where the function raised it, or where the task's workers died. `client` is that of
    dask.distributed. Each worker has a few tasks, so that it need not wait for the next one. Raises UserError where
    nobody has worked for five minutes, and where a worker has come that is not as here.
    """
    waiting = iter(tasks)
    running: dict[str, Task] = {}
    watch = Watch(client)

    def submitted(task: Task) -> Any:
        future = client.submit(function, task, key=f"palpate-{uuid.uuid4().hex}", pure=False)
        running[future.key] = task
        return future

    completed = _distributed().as_completed(loop=client.loop)
    try:
        while True:
            # Each worker holds so many tasks that it never waits for the scheduler.
            for task in islice(waiting, max(_AHEAD * max(len(watch.workers), 1) - len(running), 0)):
                completed.add(submitted(task))
            if not running:
                watch.look(at_once=True)  # whoever came last may have worked before the next look
                return
            # While nothing is done, see whether anybody works.
            while not completed.has_ready():
                watch.look()
                time.sleep(_LOOK)
            future = next(completed)
            try:
                outcome = _outcome(future)
            except _WorkerFailureError:
                completed.add(future)
                continue
            if future.status == "cancelled":
                raise UserError(f"--scheduler {client.scheduler.address}: the scheduler has gone; {GO_ON}")
            yield running.pop(future.key), outcome
            future.release()
    finally:
        with suppress(Exception):  # it has gone
            client.cancel([*completed.futures], force=True)


class _WorkerFailureError(Exception):
    """The result of a task has died with its worker before it was here: the scheduler has the task done again."""


def _outcome(future: Any) -> Any:
    """Return the result of a task, or the exception that it raised or that ended it; raises _WorkerFailureError."""
    if future.status in ("lost", "pending"):
        raise _WorkerFailureError
    try:
        return future.result(timeout=_GATHER)
    except Exception as error:
        if future.status in ("lost", "pending") or (future.status == "finished" and isinstance(error, TimeoutError)):
            raise _WorkerFailureError from error
        return error


def _demand_shared(client: Any, folder: Path) -> None:
    """Raise ConfigurationError where a worker does not see the folder of the runs."""
    token = folder / f".{uuid.uuid4().hex}"
    token.touch()
    try:
        sees_by_worker: Mapping[str, bool] = client.run(_sees, str(token))
    finally:
        token.unlink()
    for worker, sees in sees_by_worker.items():
        if not sees:
            raise ConfigurationError(
                f"{folder}: worker {worker} does not see this folder: give --out a path that all machines share, "
                "or --stage, such as s3://bucket/place (not with --each)"
            )


def _sees(path: str) -> bool:
    """Return True if a worker sees a path; it runs there."""
    return Path(path).exists()


def loss_reason(error: BaseException) -> str:
    """Return why a task has come to nothing, in words."""
    if type(error).__name__ == "KilledWorker":
        return "lost: its process was killed several times: is the memory enough?"
    return f"lost: {type(error).__name__}: {error}"
