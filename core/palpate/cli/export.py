"""``palpate export``: a log as a table, for spreadsheets and other programs."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.cli.log_info import recording_of
from palpate.device import Batch
from palpate.errors import ConfigurationError, LogError, OutputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Numbers:
    """One topic as arrays."""

    names: tuple[str, ...]
    stamps: NDArray[np.int64]  # (n,) [ns]
    values: Floats  # (n, k) as recorded


def export(
    log: Annotated[Path, typer.Argument(help="The log: .mcap, .db3, a bag folder, .csv.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="x.csv, x.npz, x.mat or x.parquet; must not exist.")],
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Only this topic; can be repeated. [default: all]")
    ] = None,
) -> None:
    """Write the numbers of a log as one table (.csv, .parquet) or one array for each field (.npz, .mat)."""
    write = _WRITERS.get(out.suffix)
    if write is None:
        raise ConfigurationError(f"--out {out}: the name must end in one of {', '.join(_WRITERS)}")
    if out.exists():
        raise OutputError(f"{out}: is there already, and nothing is ever overwritten")
    numbers = _numbers(log, topics)
    try:
        write(out, numbers)
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    rows = sum(len(entry.stamps) for entry in numbers.values())
    typer.echo(f"{rows} messages of {len(numbers)} topics are in {out}")


def _numbers(log: Path, topics: list[str] | None) -> dict[str, Numbers]:
    names: dict[str, tuple[str, ...]] = {}
    blocks: dict[str, list[Batch]] = {}
    for topic, columns, batch in recording_of(log).tables(log):
        names[topic] = columns
        if not topics or topic in topics:
            blocks.setdefault(topic, []).append(batch)
    missing = [topic for topic in topics or () if topic not in blocks]
    if missing:
        raise LogError(f"{log}: --topic {missing[0]}: holds no numbers (there are: {', '.join(names)})")
    if not blocks:
        raise LogError(f"{log}: holds no numbers")
    return {
        topic: Numbers(
            names[topic],
            np.concatenate([block.time for block in found]),
            np.concatenate([block.values for block in found]),
        )
        for topic, found in blocks.items()
    }


def _rows(numbers: Mapping[str, Numbers]) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """One table: a row for each time-stamp of any topic [ns], NaN where a topic has no message at it."""
    keys = {topic: np.stack([entry.stamps, _occurrence(entry.stamps)]) for topic, entry in numbers.items()}
    every, places = np.unique(np.concatenate(list(keys.values()), axis=1), axis=1, return_inverse=True)
    places = places.ravel()
    columns: dict[str, Floats] = {}
    begin = 0
    for topic, entry in numbers.items():
        rows = places[begin : begin + len(entry.stamps)]
        begin += len(entry.stamps)
        for k, name in enumerate(entry.names):
            column = np.full(every.shape[1], np.nan)
            column[rows] = entry.values[:, k]
            columns[f"{topic}:{name}"] = column
    return every[0], columns


def _occurrence(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) how many equal time-stamps came before each one: messages of one instant stay apart."""
    order = np.argsort(stamps, kind="stable")
    ordered = stamps[order]
    begins = np.concatenate([[True], ordered[1:] != ordered[:-1]]) if len(ordered) else np.zeros(0, bool)
    index = np.arange(len(ordered))
    found = np.zeros(len(stamps), np.int64)
    found[order] = index - np.maximum.accumulate(np.where(begins, index, 0))
    return found


def _csv(out: Path, numbers: Mapping[str, Numbers]) -> None:
    stamps, columns = _rows(numbers)
    with out.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["stamp_ns", "time_s", *columns])
        lists = [column.tolist() for column in columns.values()]
        seconds = (stamps - stamps.min()) / 1e9
        for row in zip(stamps.tolist(), seconds.tolist(), *lists, strict=True):
            writer.writerow(["" if value != value else value for value in row])


def _arrays(numbers: Mapping[str, Numbers]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for topic, entry in numbers.items():
        found[f"{topic}:stamp_ns"] = entry.stamps
        found |= {f"{topic}:{name}": entry.values[:, k] for k, name in enumerate(entry.names)}
    return found


def _npz(out: Path, numbers: Mapping[str, Numbers]) -> None:
    with out.open("xb") as file:
        np.savez_compressed(file, **{name.strip("/").replace("/", "."): a for name, a in _arrays(numbers).items()})


def _mat(out: Path, numbers: Mapping[str, Numbers]) -> None:
    """A struct for each topic, named by what MATLAB allows."""
    from scipy.io import savemat

    structs: dict[str, Any] = {}
    for topic, entry in numbers.items():
        fields: dict[str, Any] = {"stamp_ns": entry.stamps}
        fields |= {_word(name): entry.values[:, k] for k, name in enumerate(entry.names)}
        structs[_word(topic)] = fields
    with out.open("xb") as file:
        savemat(file, structs, long_field_names=True, do_compression=True)


def _word(name: str) -> str:
    word = re.sub(r"\W+", "_", name).strip("_")[:63]
    return word if word[:1].isalpha() else f"x{word}"[:63]


def _parquet(out: Path, numbers: Mapping[str, Numbers]) -> None:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError("parquet needs a library that is not here: pip install pyarrow") from error
    stamps, columns = _rows(numbers)
    pyarrow.parquet.write_table(pyarrow.table({"stamp_ns": stamps, **columns}), out)


_WRITERS: Mapping[str, Callable[[Path, Mapping[str, Numbers]], None]] = {
    ".csv": _csv,
    ".npz": _npz,
    ".mat": _mat,
    ".parquet": _parquet,
}
