"""The tables of estimates in the run folder, written during a run."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from time import monotonic
from typing import IO

from palpate import Estimates, EstimatesWriter, OutputError, Parameter, Samples
from palpate.host import Pipeline

from palpate_basics.estimates_columns import DueRows, columns_of, numbers_of
from palpate_basics.text import csv_rows

ONLINE, OFFLINE = "estimates", "estimates-offline"
TEXT = ".csv"
_FLUSH = 0.5  # [s]; what is killed keeps its rows up to then


def estimates_file(
    folder: Path, tracks: Mapping[str, Sequence[Parameter]], pipeline: Pipeline, offline: bool
) -> AbstractContextManager[EstimatesWriter]:
    """A new table in the run folder, of tracks by their names; raises OutputError where it cannot be made."""
    from palpate_basics.estimates_settings import EstimatesSettings

    settings = pipeline.tables.get("estimates")
    path, interval = folder / (OFFLINE if offline else ONLINE), pipeline.run.estimates_interval
    if isinstance(settings, EstimatesSettings) and settings.format == "parquet":
        from palpate_basics.estimates_parquet import estimates_parquet

        return estimates_parquet(path, tracks, interval)
    return _estimates_csv(path.with_suffix(TEXT), tracks, interval)


@contextmanager
def _estimates_csv(path: Path, tracks: Mapping[str, Sequence[Parameter]], interval: float) -> Iterator[EstimatesFile]:
    try:
        file = path.open("x", newline="", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error
    with file:
        yield EstimatesFile(file, tracks, interval)


class EstimatesFile:
    """``estimates.csv``: time, place, what was measured, every parameter of every track with its std; decimated.

    Numbers have ten digits, far more than any of them deserves.
    """

    def __init__(self, file: IO[str], tracks: Mapping[str, Sequence[Parameter]], interval: float) -> None:
        self._file, self._due = file, DueRows(interval)
        self._flushed = monotonic()
        csv.writer(file, lineterminator="\n").writerow(columns_of(tracks))

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """One row for each interval of time: the tip's place, what was measured, and every track's estimates."""
        self._file.write(csv_rows(numbers_of(samples, estimates, self._due.of(samples.time))))
        if (now := monotonic()) - self._flushed > _FLUSH:
            self._file.flush()
            self._flushed = now
