"""Recording to MCAP: raw streams as standard ROS 2 messages, samples and estimates as small types of our own."""

from __future__ import annotations

import queue
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Estimates, Floats, OutputError, Run, Samples, Sink, Writer, clock
from pydantic import Field

from palpate_devices.log_file import LogFile
from palpate_devices.log_recorder import FLUSH_EVERY, LogRecorder

_MAX_WAITING = 256  # pieces of work, a choice; a replay that is faster than the disk waits for it here
_SECOND = 1e9  # [ns]


class McapSink(Sink):
    """Records everything: raw streams, samples, estimates of every track, the pipeline, versions and seed.

    Topics: ``/DEVICE/STREAM`` (WrenchStamped, PoseStamped, TwistStamped, JointState, or ``palpate_msgs`` types: a
    header and float64 numbers), ``/palpate/samples``, ``/palpate/estimates/MODEL/ESTIMATOR``, both with the tip's x and
    y (NaN for an offline estimator; the samples have them). A thread of its own writes the file, flushes it six times
    and syncs it once a second, so that it opens up to the last moment after a crash.
    """

    file: str = Field(default="log.mcap", pattern=r"^[^/]+$", description="name of the file within the run folder")

    @contextmanager
    def open(self, run: Run) -> Iterator[Writer]:
        """Yield a writer of the whole run; raises OutputError where the file cannot be made or the disk is full."""
        path = run.folder / self.file
        try:
            with path.open("xb", buffering=0) as file, tempfile.TemporaryFile() as index:
                recorder = _LogWriter(LogRecorder(LogFile(file.fileno()), run, index), str(path))
                try:
                    yield recorder
                finally:
                    recorder.finish()
        except OSError as error:
            raise _unwritten(path, error) from error


def _unwritten(path: Path | str, error: OSError) -> OutputError:
    """Return the error of a log that cannot be written."""
    return OutputError(f"sink mcap: cannot write {path}: {error.strerror or error}")


class _LogWriter:
    """A queue to a thread that writes: neither the end of a chunk nor the disk ever delays a control loop."""

    def __init__(self, log: LogRecorder, path: str) -> None:
        """Take an open log and its path, and start the thread that writes to it."""
        self._log, self._path = log, path
        self._stamps: NDArray[np.int64] = np.zeros(0, np.int64)
        self._lateral: Floats = np.zeros((0, 2))
        self._begin = 0  # [ns] stamp of the time 0 of samples and estimates
        self._waiting = clock().queue(_MAX_WAITING)  # of calls; None is the last
        self._failure: Exception | None = None
        self._thread = clock().thread(self._work, "mcap sink")
        self._thread.start()

    def batch(self, device: str, batch: Batch) -> None:
        """Write raw readings."""
        self._put(lambda: self._log.batch(device, batch))

    def samples(self, samples: Samples) -> None:
        """Write aligned samples."""
        self._stamps, self._lateral = samples.stamp, samples.lateral
        if len(samples):
            self._begin = int(samples.stamp[0]) - round(float(samples.time[0]) * _SECOND)
        self._put(lambda: self._log.samples(samples))

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Write estimates of the latest samples, or of all of them."""
        stamps, lateral = self._stamps, self._lateral
        if len(stamps) != len(estimates):  # an offline estimator: all samples at once
            stamps = self._begin + np.rint(estimates.time * _SECOND).astype(np.int64)
            lateral = np.broadcast_to(np.nan, (len(estimates), 2))
        self._put(lambda: self._log.estimates(track, estimates, stamps, lateral))

    def result(self, table: Mapping[str, Any]) -> None:
        """Write the time of the last estimate where the estimates do not reach the end of the record."""
        until = table["run"].get("live", {}).get("estimates", {}).get("until")
        if until is not None:
            self._put(lambda: self._log.mark({"estimated_until": f"{until:.6f}"}))

    def _put(self, work: Callable[[], None] | None) -> None:
        """Queue a piece of work, and wait while the queue is full; raises what the thread has met."""
        if self._failure is not None:
            raise self._failure
        self._waiting.put(work)

    def finish(self) -> None:
        """Write what waits, and close the log, early where it cannot be written; raises what the thread has met."""
        self._waiting.put(None)
        self._thread.join()
        try:
            if self._failure is not None:
                raise self._failure
            self._log.finish()
        except BaseException:
            with suppress(OSError):  # no room even for that: it is whole up to its last chunk
                self._log.close_early()
            raise

    def _work(self) -> None:
        """Write what is queued, a function for each piece of work, until the end; keep the first failure.

        Where nothing is queued for a while the log is saved all the same.
        """
        while True:
            try:
                work = self._waiting.get(timeout=FLUSH_EVERY)
            except queue.Empty:
                work = _only_save
            if work is None:  # the end of the queue, from `finish`
                return
            if self._failure is not None:  # no caller waits for a log that cannot be written
                continue
            try:
                work()
                self._log.save()
            except OSError as error:
                self._failure = _unwritten(self._path, error)
            except Exception as error:  # it is raised where it is handled
                self._failure = error


def _only_save() -> None:
    """Write nothing: the log is saved after each piece of work, and also after this one."""
