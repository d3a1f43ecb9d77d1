"""Replay of a CSV log."""

from __future__ import annotations

import csv
import gzip
import hashlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Channel, Device, File, Frequency, Link, LogError, Settings, Stream, to_si
from pydantic import Field, model_validator

_SECOND = 1_000_000_000  # [ns]
_BLOCK = 4096  # rows in one batch
_SI = {"length": "m", "speed": "m/s", "force": "N", "time": "s"}


class Column(Settings):
    """One column of the file."""

    column: int = Field(ge=0, description="which column, counted from 0")
    unit: str = Field(min_length=1, description='unit of its numbers, such as "mm" or "N"')


class CsvReplay(Device):
    """A CSV file of numbers, plain or gzipped, as a device: its columns are channels of one stream.

    Time comes from a column, or from a rate. A header line is skipped. A cell that is empty or not finite counts as an
    invalid reading; text in a column that is used is a mistake of the file and refused.
    """

    file: File = Field(description="the log, .csv or .csv.gz, relative to the pipeline file")
    columns: dict[str, Column] = Field(min_length=1, description="channels by name: { column = 0, unit = 'mm' }")
    rate: Frequency | None = Field(default=None, gt=0, description="sampling rate, where no column holds the time")
    time: Column | None = Field(default=None, description="the column that holds the time: { column = 0, unit = 's' }")
    delimiter: str = Field(default=",", min_length=1, max_length=1, description="what separates the columns")

    @model_validator(mode="after")
    def _one_source_of_time(self) -> Self:
        if (self.rate is None) == (self.time is None):
            raise ValueError('give either rate = "500 Hz" or time = { column = 0, unit = "s" }')
        if self.time is not None:
            to_si(f"1 {self.time.unit}", "s")
        for column in self.columns.values():
            _si_unit(column.unit)
        return self

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream without a name: channels are addressed as ``device.channel``."""
        if not self.file.is_file():
            raise LogError(f"{self.file}: there is no such file")
        channels = tuple(Channel(name, _si_unit(column.unit)[0]) for name, column in self.columns.items())
        return (Stream("", channels, self.rate, clock="file"),)

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        with self.file.open("rb") as file:
            return {"file": str(self.file), "sha256": hashlib.file_digest(file, "sha256").hexdigest()}

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The open file."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        yield _CsvLink(self)


def _si_unit(unit: str) -> tuple[str, float]:
    """The SI unit of what a column holds, and how much of it one of its units is."""
    for si in ("m", "m/s", "N", "s", "rad", "m/s^2", "Pa"):
        try:
            return si, to_si(f"1 {unit}", si)
        except ValueError:
            continue
    if unit == "1":
        return "1", 1.0
    raise ValueError(f"unit {unit!r} is none of a length, speed, force, time or angle")


class _CsvLink:
    def __init__(self, log: CsvReplay) -> None:
        self._log = log
        scales = [(column.column, _si_unit(column.unit)[1]) for column in log.columns.values()]
        if log.time is not None:
            scales.append((log.time.column, to_si(f"1 {log.time.unit}", "s")))
        self._columns = [column for column, _ in scales]
        self._scales = np.array([scale for _, scale in scales])

    def batches(self) -> Iterator[Batch]:
        """The rows of the file in order, some thousand at a time."""
        row = 0
        for numbers in self._blocks():
            values = numbers * self._scales
            if self._log.time is None:
                assert self._log.rate is not None
                stamps = np.rint((row + np.arange(len(values))) * (_SECOND / self._log.rate)).astype(np.int64)
            else:
                seconds, values = values[:, -1], values[:, :-1]
                known = np.isfinite(seconds)
                values, stamps = values[known], np.rint(seconds[known] * _SECOND).astype(np.int64)
            row += len(numbers)
            yield Batch("", stamps, stamps, values)
        if row == 0:
            raise LogError(f"{self._log.file}: the file holds no rows of numbers")

    def _blocks(self) -> Iterator[NDArray[np.float64]]:
        path = self._log.file
        try:
            with _open_text(path) as file:
                rows = enumerate(csv.reader(file, delimiter=self._log.delimiter), start=1)
                header = True
                while lines := list(islice(rows, _BLOCK)):
                    block = []
                    for number, cells in lines:
                        if not cells:
                            continue
                        if header and not any(_is_number(cell) for cell in cells):
                            header = False
                            continue
                        header = False
                        block.append([self._number(cells, column, number) for column in self._columns])
                    if block:
                        yield np.array(block)
        except (OSError, EOFError) as error:
            raise LogError(f"{path}: cannot be read: {error}") from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise LogError(f"{path}: is not a CSV text: {error}") from error

    def _number(self, cells: list[str], column: int, line: int) -> float:
        if column >= len(cells):
            there = f"the line has {len(cells)}, 0 to {len(cells) - 1}"
            raise LogError(f"{self._log.file}:{line}: there is no column {column}; {there}")
        text = cells[column].strip()
        try:
            return float(text) if text else np.nan
        except ValueError as error:
            raise LogError(f"{self._log.file}:{line}: column {column} holds {text!r}, which is no number") from error


def _open_text(path: Path) -> IO[str]:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8", newline="")
    return path.open(newline="", encoding="utf-8")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
