"""Samples as a CSV file, for spreadsheets and plotting scripts."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from palpate import Batch, Estimates, OutputError, Run, Samples, Sink, Writer
from pydantic import Field

_HEADER = ["time_s", "force_N", "position_m", "velocity_m_s", "contact", "active"]


class CsvSink(Sink):
    """Writes the aligned samples, one row each, with a header that names the units."""

    file: str = Field(default="samples.csv", pattern=r"^[^/]+$", description="name of the file within the run folder")

    @contextmanager
    def open(self, run: Run) -> Iterator[Writer]:
        """Open a writer of the samples; raises OutputError if the file cannot be written."""
        path = run.folder / self.file
        try:
            with path.open("x", newline="", encoding="utf-8") as file:
                yield _SampleRows(file)
        except OSError as error:
            raise OutputError(f"sink csv: cannot write {path}: {error.strerror}") from error


class _SampleRows:
    """A writer of one row for each sample, below a line of names and units."""

    def __init__(self, file: Any) -> None:
        self._rows = csv.writer(file, lineterminator="\n")
        self._rows.writerow(_HEADER)

    def batch(self, device: str, batch: Batch) -> None:
        """Write nothing: raw readings are in the log of the run."""

    def samples(self, samples: Samples) -> None:
        """Write a row for each sample."""
        columns = (samples.time, samples.force, samples.position, samples.velocity)
        marks = (samples.contact.astype(int), samples.active.astype(int))
        self._rows.writerows(zip(*(column.tolist() for column in (*columns, *marks)), strict=True))

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Write nothing: the run folder has the estimates in estimates.csv."""
