"""The tables of estimates in columns: a stream of Arrow during a run, Parquet once it has ended.

A Parquet file cannot be read without its last bytes, so a killed run would leave nothing. A stream keeps every batch
written, and any reader of Arrow takes it: pyarrow.ipc.open_stream, polars.read_ipc_stream.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import IO, Any

import numpy as np
from palpate import ConfigurationError, Estimates, Floats, LogError, OutputError, Parameter, Samples

from palpate_kit.runs.estimates_columns import DueRows, columns_of, numbers_of

STREAM, WHOLE = ".arrows", ".parquet"  # suffixes of a table while it grows, and when it has ended
_WAIT = 0.5  # [s] at most until rows are in the file; what is killed keeps its rows up to then
_TOGETHER = 1 << 14  # rows of a batch of the stream, at most: a choice
_GROUP = 1 << 17  # rows of a group of Parquet, which is held in memory: a choice


@contextmanager
def estimates_parquet(
    path: Path, tracks: Mapping[str, Sequence[Parameter]], interval: float
) -> Iterator[EstimatesStream]:
    """Yield a new table in columns, `path` without its suffix; raises OutputError where it cannot be made."""
    stream = path.with_suffix(STREAM)
    with _output_errors(stream):
        table = EstimatesStream(stream.open("xb"), tracks, interval)
    try:
        yield table
    finally:  # a run that is stopped has its table, too
        with _output_errors(stream):
            table.close()
            _to_parquet(stream, path.with_suffix(WHOLE))


@contextmanager
def _output_errors(stream: Path) -> Iterator[None]:
    """Turn the operating system's errors within the context into OutputError."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{stream}: cannot write: {error.strerror or error}") from error


class EstimatesStream:
    """The columns of ``estimates.csv`` as numbers of eight bytes, ``status`` of four; decimated."""

    def __init__(self, file: IO[bytes], tracks: Mapping[str, Sequence[Parameter]], interval: float) -> None:
        pyarrow = _pyarrow()
        names = columns_of(tracks)
        self._kinds = [pyarrow.uint32() if name.endswith(":status") else pyarrow.float64() for name in names]
        self._schema = pyarrow.schema(list(zip(names, self._kinds, strict=True)))
        self._file, self._writer = file, pyarrow.ipc.new_stream(file, self._schema)
        self._due = DueRows(interval)
        self._waiting: list[Floats] = []  # (n, columns) each
        self._rows, self._written = 0, monotonic()

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """One row for each interval of time: the tip's place, what was measured, and every track's estimates."""
        table = numbers_of(samples, estimates, self._due.of(samples.time))
        if len(table):
            self._waiting.append(table)
            self._rows += len(table)
        if self._rows >= _TOGETHER or monotonic() - self._written > _WAIT:
            self._hand_over()

    def _hand_over(self) -> None:
        """Write the waiting rows as one batch, each column in its type."""
        pyarrow = _pyarrow()
        self._written = monotonic()
        if not self._rows:
            return
        columns = np.concatenate([table.T for table in self._waiting], axis=1)
        self._waiting, self._rows = [], 0
        typed = (
            column.astype(column_type.to_pandas_dtype(), copy=False)
            for column, column_type in zip(columns, self._kinds, strict=True)
        )
        self._writer.write_batch(pyarrow.record_batch([pyarrow.array(column) for column in typed], schema=self._schema))
        self._file.flush()

    def close(self) -> None:
        """Write the rest, and the end of the stream."""
        with self._file:
            self._hand_over()
            self._writer.close()


def _to_parquet(stream: Path, path: Path) -> None:
    """Write a stream of Arrow that has ended as Parquet, and remove it; a group of rows is in memory at a time."""
    pyarrow = _pyarrow()
    import pyarrow.parquet as parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]

    draft = path.with_suffix(f"{path.suffix}.part")
    with (
        stream.open("rb") as file,
        pyarrow.ipc.open_stream(file) as reader,
        # Numbers of measurements hardly ever repeat: a dictionary of them would be tried for nothing.
        parquet.ParquetWriter(draft, reader.schema, use_dictionary=False, write_page_checksum=True) as writer,
    ):
        for group in _groups(reader):
            writer.write_table(pyarrow.Table.from_batches(group, reader.schema))
    os.replace(draft, path)
    stream.unlink()


def _groups(batches: Any) -> Iterator[list[Any]]:
    """Yield batches in groups of so many rows or more, the last one with what remains."""
    group: list[Any] = []
    for batch in batches:
        group.append(batch)
        if sum(len(waiting_batch) for waiting_batch in group) >= _GROUP:
            yield group
            group = []
    if group:
        yield group


def read_columns(path: Path) -> tuple[tuple[str, ...], Floats]:
    """Return names and numbers (n, columns) of a table in columns; of a stream that was cut, the complete part.

    Raises LogError for what cannot be read.
    """
    pyarrow = _pyarrow()
    try:
        with path.open("rb") as file:
            if path.suffix == WHOLE:
                import pyarrow.parquet as parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]

                table = parquet.read_table(file, page_checksum_verification=True)
            else:
                table = _complete_batches(file)
        columns = [np.asarray(column.to_numpy(), np.float64) for column in table.columns]
    except (OSError, ValueError, TypeError, pyarrow.ArrowException) as error:
        raise LogError(f"{path}: is not a table of numbers: {error}") from error
    return tuple(table.column_names), np.column_stack(columns) if columns else np.zeros((0, 0))


def _complete_batches(file: IO[bytes]) -> Any:
    """Return the table of all batches of a stream that are complete."""
    pyarrow = _pyarrow()
    if not file.peek(1):  # type: ignore[attr-defined]
        return pyarrow.table({})  # killed before its first bytes
    reader, batches = pyarrow.ipc.open_stream(file), []
    while True:
        try:
            batches.append(reader.read_next_batch())
        except (StopIteration, OSError, pyarrow.ArrowInvalid):
            return pyarrow.Table.from_batches(batches, reader.schema)


def _pyarrow() -> Any:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.ipc  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError('a table in Parquet needs pyarrow; pip install "palpate[parquet]"') from error
    return pyarrow
