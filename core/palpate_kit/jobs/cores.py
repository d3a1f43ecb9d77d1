"""The engine of this machine: jobs in processes of their own."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool

from palpate import UserError

from palpate_kit.jobs.job import Job, Outcome, Parcel, RunAnswer, cached_result, run_job, run_parcel
from palpate_kit.jobs.process_pool import core_count, process_pool

_DEATHS = 3  # processes that a job may take with it: a choice


def on_all_cores(jobs: Sequence[Job], workers: int | None = None) -> Generator[tuple[Job, Outcome]]:
    """Run jobs in processes of this machine, by default one for each core; yield each with its outcome.

    Where a process is killed, as the kernel does when memory is short, what is unfinished is run again in fresh ones:
    jobs that ran at the same time one by one, so that the one that kills its process is known and given up after three.
    """
    count = min(workers or core_count(), len(jobs))
    if count <= 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    waiting: deque[Job] = deque(jobs)
    suspects: deque[tuple[Job, int]] = deque()  # and how many processes died while each ran
    while waiting or suspects:
        if waiting:
            # Those that ran when a process died are suspects, and run by themselves.
            suspects.extend([(job, 1) for job in (yield from _pooled(waiting, count))])
            continue
        job, deaths = suspects.popleft()
        if (result := cached_result(job)) is not None:  # it was done, only its answer was lost
            yield job, RunAnswer(result)
        elif (yield from _pooled(deque([job]), 1)):
            if deaths + 1 < _DEATHS:
                suspects.append((job, deaths + 1))
            else:
                reason = f"its process was killed {_DEATHS} times: is the memory enough?"
                yield job, UserError(f"lost: {reason}")


def _pooled(waiting: deque[Job], count: int) -> Generator[tuple[Job, Outcome], None, list[Job]]:
    """Run waiting jobs in so many processes until one of these dies; yield each that is done with its outcome.

    Return the jobs that were running then.
    """
    running: dict[Future[Outcome], Job] = {}
    with process_pool(count) as pool:
        try:
            while waiting or running:
                while waiting and len(running) < count:
                    running[pool.submit(run_parcel, Parcel.of(waiting[0]))] = waiting[0]
                    waiting.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        continue
                    job = running.pop(future)
                    yield job, future.result() if error is None else UserError(f"lost: {error}")
                if any(future.done() for future in running):
                    break
        except BrokenProcessPool:
            pass  # it died before it was given anything more
        finally:
            pool.shutdown(cancel_futures=True)
    return list(running.values())
