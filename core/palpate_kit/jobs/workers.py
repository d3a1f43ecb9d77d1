"""Workers of a scheduler: who they are, whether they are as this machine is, and whether anybody is left."""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, UserError

GO_ON = "what is finished is in the folder; sweep and fit go on with the same --out"
_MUST_AGREE = ("palpate", "python", "casadi", "numpy", "scipy")  # else nobody knows what was computed
_TO_THE_BIT = ("machine", "libc", "llvmlite", "cpu")  # where these agree, too, so do the bits
_AGAIN = 1.0  # [s] between looks at who works: a choice
_REPORT_EVERY = 10.0  # [s] between sentences where nobody does: a choice
_WITHOUT = 300.0  # [s] until that is the end: a choice, for a scheduler of a queue starts workers slowly


class Watch:
    """Watch over the workers of a client: those who come later are looked at, too, and a scheduler without workers is
    reported."""

    def __init__(self, client: Any) -> None:
        self._client, self._address = client, client.scheduler.address
        self._paused: frozenset[str] = frozenset()
        self.workers = self._ask_workers() or frozenset()
        self._next = time.monotonic() + _AGAIN
        self._since: float | None = None  # when the last one went
        self._reported = 0.0

    def _ask_workers(self) -> frozenset[str] | None:
        """Return the names of the workers that take work; None where the scheduler does not answer.

        dask pauses a worker whose memory comes near its limit, and one whose memory stays there begins nothing again.
        """
        try:
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, TimeoutError, RuntimeError):  # RuntimeError: it is looking for its scheduler
            self._paused = frozenset()
            return None
        self._paused = frozenset(name for name, worker in workers.items() if worker["status"] == "paused")
        return frozenset(workers) - self._paused

    def look(self, at_once: bool = False) -> None:
        """Ask the scheduler for its workers where it is time to, or `at_once`; fresh ones must have our versions.

        Raises UserError where nobody has worked for too long, as `spread` does.
        """
        now = time.monotonic()
        if now < self._next and not at_once:
            return
        self._next = now + _AGAIN
        workers = self._ask_workers()
        if workers:
            if fresh := workers - self.workers:
                with suppress(OSError, TimeoutError):  # it has gone already
                    demand_alike(self._client, self._address, fresh)
            self.workers, self._since = workers, None
            return
        if self._since is None:
            self._since, self._reported = now, now
        if now - self._since > _WITHOUT:
            raise UserError(
                f"--scheduler {self._address}: {self._nobody(workers)} for {_WITHOUT:.0f} s, and nobody else has come; "
                f"{GO_ON}"
            )
        if now - self._reported >= _REPORT_EVERY:
            self._reported = now
            begin = datetime.now(UTC).astimezone() - timedelta(seconds=time.monotonic() - self._since)
            print(
                f"{self._nobody(workers)} since {begin:%H:%M:%S}: {self._remedy()}",
                file=sys.stderr,
            )

    def _nobody(self, workers: frozenset[str] | None) -> str:
        if self._paused:
            return "all workers have been paused near the end of their memory"
        return "the scheduler has not answered" if workers is None else "there has been no worker"

    def _remedy(self) -> str:
        if self._paused:
            return "restart them, with a larger --memory-limit"
        return f"start some, such as `dask worker {self._address}`"


def demand_alike(client: Any, address: str, only: Collection[str] | None = None) -> Mapping[str, Mapping[str, str]]:
    """Return the facts of all workers or of `only` some, such as their versions, by their addresses.

    Raises ConfigurationError where one has other versions than this machine, or several threads.
    """
    this_machine = machine()
    workers: Mapping[str, Mapping[str, str]] = client.run(machine, workers=None if only is None else list(only))
    if not workers:
        raise ConfigurationError(
            f"--scheduler {address}: has no workers yet: start some, such as `dask worker {address}`"
        )
    for name, other_machine in workers.items():
        for library in _MUST_AGREE:
            if this_machine[library] != other_machine[library]:
                raise ConfigurationError(
                    f"--scheduler {address}: worker {name} has {library} {other_machine[library]}, and here is "
                    f"{this_machine[library]}: results would not be the same; install the same versions everywhere"
                )
    for name, facts in client.scheduler_info(n_workers=-1)["workers"].items():
        if name in workers and facts["nthreads"] != 1:
            raise ConfigurationError(
                f"--scheduler {address}: worker {name} has {facts['nthreads']} threads, and a run needs a process "
                "of its own: start workers with --nthreads 1"
            )
    return workers


def provenance(address: str, workers: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return who computes, and whether all of them give the same bits as this machine."""
    this_machine = machine()
    alike = all(other_machine[key] == this_machine[key] for other_machine in workers.values() for key in _TO_THE_BIT)
    return {
        "scheduler": address,
        "here": this_machine,
        "workers": dict(workers),
        "equal": "to the bit" if alike else "to 1e-10",
    }


def machine() -> dict[str, str]:
    """Return what results depend on besides the pipeline: versions, C library, processor."""
    facts = {"palpate": version("palpate"), "python": platform.python_version(), "host": platform.node()}
    for name in ("casadi", "numpy", "scipy", "llvmlite"):
        try:
            facts[name] = version(name)
        except PackageNotFoundError:
            facts[name] = "none"
    return facts | {
        "machine": f"{platform.system()} {platform.machine()}",
        "libc": " ".join(platform.libc_ver()),
        "cpu": _processor(),
    }


def _processor() -> str:
    """Return what the processor can do, as far as its kernel says."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith(("flags", "Features")):
                return " ".join(sorted(line.partition(":")[2].split()))
    return platform.processor()
