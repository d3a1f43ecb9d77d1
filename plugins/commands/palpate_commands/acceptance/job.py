"""The run that is to be stopped, as the protocol sees it: a process with a folder."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from palpate_engine import approved_plugins

from palpate_commands.acceptance.strokes_run import MESSAGES, StrokesRun

_INTERRUPT_TIMEOUT = 10.0  # [s] for a run to stop by Ctrl-C, before it is killed: a choice


class StrokesJob(ABC):
    """A run of strokes at work; at the end of the context nothing of it is left."""

    def __init__(self, run: StrokesRun) -> None:
        self.run = run

    def __enter__(self) -> Self:
        return self

    @abstractmethod
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    @property
    @abstractmethod
    def is_running(self) -> bool:
        """True as long as its main process is there."""

    @property
    @abstractmethod
    def has_processes(self) -> bool:
        """True as long as any of its processes is there."""

    @abstractmethod
    def send(self, number: signal.Signals, group: bool = False) -> None:
        """Send a signal to its main process, or to the `group` of all of its processes."""


class ProcessJob(StrokesJob):
    """A run of strokes in a process and a session of its own."""

    def __init__(self, file: Path, overrides: Sequence[str], run: StrokesRun) -> None:
        """Start a process that makes the strokes of a run, with the pipeline in a file; its folder is made here."""
        super().__init__(run)
        run.folder.mkdir(parents=True)
        settings = {
            "file": str(file.resolve()),
            "overrides": list(overrides),
            "strokes": run.strokes.table(),
            "stop_force": run.stop_force,
            "folder": str(run.folder.resolve()),
            "approved": sorted(approved_plugins()),
        }
        self._errors = (run.folder / MESSAGES).open("wb")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "palpate_commands.acceptance.motion", json.dumps(settings)],
            stdin=subprocess.PIPE,
            stdout=self._errors,
            stderr=self._errors,
            start_new_session=True,
        )

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.is_running:
            self.send(signal.SIGCONT)
            self.send(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_INTERRUPT_TIMEOUT)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._errors.close()

    @property
    def is_running(self) -> bool:
        """True as long as its main process is there."""
        return self._process.poll() is None

    @property
    def has_processes(self) -> bool:
        """True as long as any process of its group is there."""
        if self.is_running:
            return True
        try:
            os.killpg(self._process.pid, 0)
        except ProcessLookupError:
            return False
        return True

    def send(self, number: signal.Signals, group: bool = False) -> None:
        """Send a signal to its main process, or to the `group` of all of its processes."""
        with suppress(ProcessLookupError):
            if group:
                os.killpg(self._process.pid, number)
            else:
                self._process.send_signal(number)
