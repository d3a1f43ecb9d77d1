"""Jobs on many machines: what `dask.distributed` runs, wherever its scheduler is."""

from __future__ import annotations

import json
import platform
import uuid
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from palpate import ConfigurationError
from palpate.host import write_whole

from palpate_studies.jobs import Engine, Job, finished, run_job

_MUST_AGREE = ("palpate", "python", "casadi", "numpy", "scipy")  # else nobody knows what was computed
_TO_THE_BIT = ("machine", "libc", "llvmlite", "cpu")  # where these agree, too, so do the bits
_AHEAD = 2  # jobs that a worker holds, so that it never waits for the scheduler
Task = TypeVar("Task")
_PATIENCE = "10s"  # for a scheduler to answer


def on_cluster(address: str, folder: Path) -> Engine:
    """The engine of a scheduler at an address such as ``tcp://10.0.0.5:8786``, for jobs whose runs go into a folder.

    Where a worker is killed its jobs go to others, and one that has killed three is given up. Raises
    ConfigurationError where nobody answers, or where the workers are not what is here.
    """

    def engine(jobs: Sequence[Job]) -> Generator[tuple[Job, dict[str, Any]]]:
        with connected(address, folder) as client:
            everywhere = [_placed(job) for job in jobs]
            done = spread(client, run_or_find, everywhere)
            try:
                for job, outcome in done:
                    if isinstance(outcome, BaseException):
                        yield job, {"error": f"lost: {_reason(outcome)}"}
                    else:
                        yield job, outcome
            except KeyboardInterrupt:
                yield jobs[0], {"interrupted": "interrupted by the user"}
            finally:
                done.close()

    return engine


def _placed(job: Job) -> Job:
    """A job whose paths mean the same wherever it runs."""
    return replace(job, path=str(Path(job.path).resolve()), folder=str(Path(job.folder).resolve()))


def run_or_find(job: Job) -> dict[str, Any]:
    """What a job finds: already there where only its answer was lost with a worker."""
    return found if (found := finished(job)) is not None else run_job(job)


def _distributed() -> Any:
    """The package; raises ConfigurationError where it is not installed."""
    try:
        import distributed
    except ImportError:
        raise ConfigurationError('--scheduler needs dask.distributed; pip install "palpate[cluster]"') from None
    return distributed


@contextmanager
def connected(address: str, folder: Path) -> Iterator[Any]:
    """A client of a scheduler whose workers are as here and see the folder."""
    try:
        client = _distributed().Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigurationError(f"--scheduler {address}: no scheduler answers there: {error}") from error
    with client:
        workers = demand_alike(client, address)
        _demand_shared(client, folder)
        write_whole(folder / "workers.json", json.dumps(provenance(address, workers), indent=2) + "\n")
        yield client


def spread(client: Any, function: Callable[[Task], Any], tasks: Sequence[Task]) -> Generator[tuple[Task, Any]]:
    """What a function makes of every task, in any order; an exception where it raised, or where its workers died."""
    left = iter(tasks)
    running: dict[str, Task] = {}
    ahead = _AHEAD * max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)

    def submitted(task: Task) -> Any:
        future = client.submit(function, task, key=f"palpate-{uuid.uuid4().hex}", pure=False)
        running[future.key] = task
        return future

    completed = _distributed().as_completed(loop=client.loop)
    try:
        for task in islice(left, ahead):
            completed.add(submitted(task))
        while running:
            future = next(completed)
            task = running.pop(future.key)
            yield task, future.result() if future.status == "finished" else future.exception()
            future.release()
            for following in islice(left, 1):
                completed.add(submitted(following))
    finally:
        with suppress(Exception):  # it has gone
            client.cancel([*completed.futures], force=True)


def demand_alike(client: Any, address: str) -> Mapping[str, Mapping[str, str]]:
    """What the workers are; raises ConfigurationError where one has other versions, or several threads."""
    here = machine()
    workers: Mapping[str, Mapping[str, str]] = client.run(machine)
    if not workers:
        raise ConfigurationError(
            f"--scheduler {address}: has no workers yet: start some, such as `dask worker {address}`"
        )
    for name, there in workers.items():
        for what in _MUST_AGREE:
            if here[what] != there[what]:
                raise ConfigurationError(
                    f"--scheduler {address}: worker {name} has {what} {there[what]}, and here is {here[what]}: results "
                    "would not be the same; install the same versions everywhere"
                )
    for name, told in client.scheduler_info(n_workers=-1)["workers"].items():
        if told["nthreads"] != 1:
            raise ConfigurationError(
                f"--scheduler {address}: worker {name} has {told['nthreads']} threads, and a run wants a process "
                "of its own: start workers with --nthreads 1"
            )
    return workers


def provenance(address: str, workers: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Who computes, and whether all of them give the same bits as this machine."""
    here = machine()
    alike = all(there[what] == here[what] for there in workers.values() for what in _TO_THE_BIT)
    return {
        "scheduler": address,
        "here": here,
        "workers": dict(workers),
        "equal": "to the bit" if alike else "to 1e-10",
    }


def machine() -> dict[str, str]:
    """What results depend on besides the pipeline: versions, C library, processor."""
    found = {"palpate": version("palpate"), "python": platform.python_version(), "host": platform.node()}
    for name in ("casadi", "numpy", "scipy", "llvmlite"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found | {
        "machine": f"{platform.system()} {platform.machine()}",
        "libc": " ".join(platform.libc_ver()),
        "cpu": _processor(),
    }


def _processor() -> str:
    """What the processor can do, as far as its kernel says."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith(("flags", "Features")):
                return " ".join(sorted(line.partition(":")[2].split()))
    return platform.processor()


def _demand_shared(client: Any, folder: Path) -> None:
    """Raise ConfigurationError where a worker does not see the folder of the runs."""
    token = folder / f".{uuid.uuid4().hex}"
    token.touch()
    try:
        seen: Mapping[str, bool] = client.run(_sees, str(token))
    finally:
        token.unlink()
    for worker, sees in seen.items():
        if not sees:
            raise ConfigurationError(
                f"{folder}: worker {worker} does not see this folder: give --out a path that all machines share"
            )


def _sees(path: str) -> bool:
    return Path(path).exists()


def _reason(error: BaseException) -> str:
    if type(error).__name__ == "KilledWorker":
        return "its process was killed several times: is the memory enough?"
    return f"{type(error).__name__}: {error}"
