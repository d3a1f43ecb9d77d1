"""The tables of estimates in the run folder, written during a run."""

from __future__ import annotations

import csv
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from time import monotonic
from typing import IO

from palpate import Estimates, EstimatesWriter, Floats, OutputError, Parameter, Samples
from palpate_engine import Pipeline, is_live

from palpate_kit.runs.csv_writer import csv_rows
from palpate_kit.runs.estimates_columns import DueRows, columns_of, numbers_of

ONLINE, OFFLINE = "estimates", "estimates-offline"
TEXT = ".csv"
_FLUSH = 0.5  # [s]; what is killed keeps its rows up to then: a choice
_TOGETHER = 4096  # rows whose numbers are gathered at once: a choice, for memory
_WAITING = 4  # blocks of rows that wait to be written: a choice, for memory


def estimates_file(
    folder: Path, tracks: Mapping[str, Sequence[Parameter]], pipeline: Pipeline, offline: bool
) -> AbstractContextManager[EstimatesWriter]:
    """Return a new table in the run folder, of tracks by their names; raises OutputError where it cannot be made."""
    from palpate_kit.runs.estimates_settings import EstimatesSettings

    settings = pipeline.tables.get("estimates")
    path = folder / (OFFLINE if offline else ONLINE)
    if isinstance(settings, EstimatesSettings) and settings.format == "parquet":
        from palpate_kit.runs.estimates_parquet import estimates_parquet

        return estimates_parquet(path, tracks, pipeline.run.estimates_interval)
    return _estimates_csv(path.with_suffix(TEXT), tracks, pipeline)


@contextmanager
def _estimates_csv(
    path: Path, tracks: Mapping[str, Sequence[Parameter]], pipeline: Pipeline
) -> Iterator[EstimatesWriter]:
    """Yield a new table as text: of a live run one that is written at once, else one that a thread writes.

    `tracks` has the parameters of each track, which name the columns. Raises OutputError where it cannot be written.
    """
    live = is_live(pipeline.devices)
    try:
        file = path.open("x", newline="", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error
    try:
        with file:
            table = EstimatesFile(file, tracks, pipeline.run.estimates_interval)
            if live:
                yield table
                return
            with ThreadPoolExecutor(1, "estimates") as thread:
                aside = _Aside(table, thread)
                try:
                    yield aside
                finally:  # a run that is stopped has its table, too
                    aside.finish()
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror or error}") from error


class EstimatesFile:
    """``estimates.csv``: time, place, what was measured, every parameter of every track with its std; decimated.

    Numbers have ten digits, far more than are significant.
    """

    def __init__(self, file: IO[str], tracks: Mapping[str, Sequence[Parameter]], interval: float) -> None:
        self._file, self._due = file, DueRows(interval)
        self._flushed = monotonic()
        csv.writer(file, lineterminator="\n").writerow(columns_of(tracks))

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """One row for each interval of time: the tip's place, what was measured, and every track's estimates."""
        for numbers in self.due(samples, estimates):
            self.append(numbers)

    def due(self, samples: Samples, estimates: Mapping[str, Estimates]) -> Iterator[Floats]:
        """Yield the rows (n, columns) of a block that are due, some thousand at a time; once none, where none is."""
        rows = self._due.of(samples.time)
        for begin in range(0, max(len(rows), 1), _TOGETHER):
            yield numbers_of(samples, estimates, rows[begin : begin + _TOGETHER])

    def append(self, numbers: Floats) -> None:
        """Write rows (n, columns), and flush where it is time to."""
        self._file.write(csv_rows(numbers))
        if (now := monotonic()) - self._flushed > _FLUSH:
            self._file.flush()
            self._flushed = now


class _Aside:
    """Has a thread write the rows, for a run without a deadline: text is a fifth of a replay's work."""

    def __init__(self, table: EstimatesFile, thread: ThreadPoolExecutor) -> None:
        self._table, self._thread = table, thread
        self._waiting: deque[Future[None]] = deque()
        self._failed = False

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """See `EstimatesFile`; raises here what the thread has met."""
        for numbers in self._table.due(samples, estimates):
            while self._waiting and (len(self._waiting) >= _WAITING or self._waiting[0].done()):
                self._waiting.popleft().result()
            self._waiting.append(self._thread.submit(self._append, numbers))

    def _append(self, numbers: Floats) -> None:
        """Append rows to the table, in the thread; none after a failure: they would be misread without those before."""
        if self._failed:  # rows after those that are missing would be misread
            return
        try:
            self._table.append(numbers)
        except BaseException:
            self._failed = True
            raise

    def finish(self) -> None:
        """Wait for the rest; raises the thread's exception."""
        while self._waiting:
            self._waiting.popleft().result()
