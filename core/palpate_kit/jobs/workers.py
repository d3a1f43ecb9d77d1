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
_AGAIN = 1.0  # [s] between looks at who works
_TELL = 10.0  # [s] between words where nobody does
_WITHOUT = 300.0  # [s] until that is the end


class Watch:
    """Who works for a client: those who come later are looked at, too, and a scheduler without workers is reported."""

    def __init__(self, client: Any) -> None:
        self._client, self._address = client, client.scheduler.address
        self._paused: frozenset[str] = frozenset()
        self.workers = self._asked() or frozenset()
        self._next = time.monotonic() + _AGAIN
        self._since: float | None = None  # when the last one went
        self._told = 0.0

    def _asked(self) -> frozenset[str] | None:
        """Names of the workers that take work; None where the scheduler does not answer.

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
        """Look again where it is time to, or `at_once`; raises UserError as `spread` does."""
        now = time.monotonic()
        if now < self._next and not at_once:
            return
        self._next = now + _AGAIN
        workers = self._asked()
        if workers:
            if fresh := workers - self.workers:
                with suppress(OSError, TimeoutError):  # it has gone already
                    demand_alike(self._client, self._address, fresh)
            self.workers, self._since = workers, None
            return
        if self._since is None:
            self._since, self._told = now, now
        if now - self._since > _WITHOUT:
            raise UserError(
                f"--scheduler {self._address}: {self._nobody(workers)} for {_WITHOUT:.0f} s, and nobody else has come; "
                f"{GO_ON}"
            )
        if now - self._told >= _TELL:
            self._told = now
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
    """What all or some workers are; raises ConfigurationError where one has other versions, or several threads."""
    here = machine()
    workers: Mapping[str, Mapping[str, str]] = client.run(machine, workers=None if only is None else list(only))
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
        if name in workers and told["nthreads"] != 1:
            raise ConfigurationError(
                f"--scheduler {address}: worker {name} has {told['nthreads']} threads, and a run needs a process "
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
