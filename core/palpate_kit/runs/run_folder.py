"""The run folder, read back: the one place that knows how a run is laid out."""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Container, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError, Status
from palpate_engine import GIVEN, PIPELINE, RESULT, bounded_text, toml_tables

from palpate_kit.runs.estimates_columns import missing_columns
from palpate_kit.runs.estimates_file import OFFLINE, ONLINE, TEXT
from palpate_kit.runs.estimates_parquet import STREAM, WHOLE, read_columns
from palpate_kit.runs.result_file import is_whole, read_result
from palpate_kit.runs.review_file import read_marks

_OLDER = "resolved.toml"  # the pipeline of an older run, whose pipeline.toml is as given
_UNUSABLE = Status.IDLE | Status.WAITING | Status.DIVERGED


@dataclass(frozen=True)
class TrackTable:
    """The estimates of one track over time [SI]; NaN where a row has none."""

    time: Floats  # (n,) [s]
    place: Floats  # (n, 2) [m] x and y of the tip
    position: Floats  # (n,) [m] its height along the normal; NaN where a table is older
    values: Mapping[str, Floats]  # (n,) each, by parameter
    std: Mapping[str, Floats]  # (n,) each, as the estimator gives it
    others: Mapping[str, Floats]  # (n,) each: surface, surface_std, force, nis, ...
    status: NDArray[np.int64]  # (n,) of Status

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(n,) True where there is an estimate that the track stands by."""
        return np.asarray((self.status & int(_UNUSABLE)) == 0)


@dataclass(frozen=True)
class EstimatesTable:
    """A table of estimates; a last line that a crash has cut short is left out."""

    path: Path
    names: tuple[str, ...]
    numbers: Floats  # (n, columns)

    def __post_init__(self) -> None:
        """Raise LogError where a column is missing, or is there twice."""
        if missing := missing_columns(self.names, self.tracks):
            raise LogError(f"{self.path}: is a damaged table of estimates: its column {missing[0]} is missing")

    @property
    def tracks(self) -> tuple[str, ...]:
        """Names of the tracks, in the order of the table."""
        return tuple(name.removesuffix(":status") for name in self.names if name.endswith(":status"))

    @property
    def measured(self) -> dict[str, Floats]:
        """Time [s], tared force [N], position [m] and velocity [m/s], (n,) each; NaN where a table is older."""
        names = {"time": "time_s", "force": "force_N", "position": "position_m", "velocity": "velocity_m_s"}
        unknown = np.full(len(self.numbers), np.nan)
        return {key: self._column(name) if name in self.names else unknown for key, name in names.items()}

    def track(self, name: str) -> TrackTable:
        """Return the columns of one track; raises LogError where the table has none of that name."""
        head = f"{name}:"
        columns = {column[len(head) :]: self._column(column) for column in self.names if column.startswith(head)}
        if "status" not in columns:
            raise LogError(f"{self.path}: no track {name!r} (there are: {', '.join(self.tracks)})")
        status = np.nan_to_num(columns.pop("status"), nan=float(Status.IDLE)).astype(np.int64)
        parameters = [key.removesuffix("_std") for key in columns if key.endswith("_std") and key != "surface_std"]
        return TrackTable(
            time=self._column("time_s"),
            place=np.column_stack([self._column(name) for name in ("x_m", "y_m")]),
            position=self.measured["position"],
            values={key: columns[key] for key in parameters},
            std={key: columns[f"{key}_std"] for key in parameters},
            others={key: column for key, column in columns.items() if key.removesuffix("_std") not in parameters},
            status=status,
        )

    def _column(self, name: str) -> Floats:
        return np.asarray(self.numbers[:, self.names.index(name)])


def pipeline_among(names: Container[str]) -> str | None:
    """Return which of the documents of a run, by name, is the pipeline that reproduces it; None if it has none."""
    return next((name for name in (_OLDER, PIPELINE) if name in names), None)


@dataclass(frozen=True)
class RunFolder:
    """A run's folder: its result, pipeline, estimates and continuations."""

    path: Path

    @property
    def finished(self) -> bool:
        """True if there is a result; half of one does not count."""
        return is_whole(self.path / RESULT)

    @cached_property
    def result(self) -> dict[str, Any]:
        """The contents of ``result.json``; raises LogError if it is missing or damaged."""
        return read_result(self.path / RESULT)

    @property
    def began(self) -> bool:
        """True if there is a pipeline that was run."""
        return self._pipeline_name is not None

    @property
    def pipeline(self) -> Path:
        """The file of the pipeline that reproduces the run, overrides included; raises LogError if it is missing."""
        if (name := self._pipeline_name) is None:
            raise LogError(f"{self.path}: is not a run folder: it has no {PIPELINE}")
        return self.path / name

    @property
    def pipeline_text(self) -> str:
        """The text of `pipeline`; raises LogError if it is missing or cannot be read."""
        return _text(self.pipeline)

    @property
    def settings(self) -> dict[str, Any]:
        """The tables of `pipeline`, as resolved; raises LogError if it is missing or damaged."""
        try:
            return toml_tables(self.pipeline_text)
        except tomllib.TOMLDecodeError as error:
            raise LogError(f"{self.pipeline}: is a damaged pipeline, and not TOML: {error}") from error

    @property
    def given(self) -> Path:
        """The file of the pipeline as it was given, with its comments; it need not be there."""
        return self.path / (PIPELINE if self._pipeline_name == _OLDER else GIVEN)

    @property
    def documents(self) -> dict[str, str]:
        """The pipeline as run and as given, by the names under which a log carries them; raises LogError."""
        names = [self.pipeline.name, self.given.name] if self.began else []
        return {name: _text(self.path / name) for name in names if (self.path / name).is_file()}

    @property
    def _pipeline_name(self) -> str | None:
        return pipeline_among([name for name in (_OLDER, PIPELINE) if (self.path / name).is_file()])

    @property
    def rejected(self) -> dict[str, str]:
        """Reasons for which a review left the run out, under "", or parts of it, under their names. Raises LogError."""
        return read_marks(self.path).rejected

    @property
    def maps(self) -> Path:
        """Folder of the maps of the run."""
        return self.path / "maps"

    @property
    def rehearsal(self) -> str | None:
        """The twin in whose simulated time the run was made, or None of one that measured; raises LogError.

        Earlier versions wrote it into the result only.
        """
        if "rehearsal" in (settings := self.settings.get("run", {})):
            return str(settings["rehearsal"])
        rehearsal = self.result["run"].get("rehearsal") if self.finished else None
        return None if rehearsal is None else str(rehearsal["twin"])

    @property
    def parts(self) -> list[RunFolder]:
        """This folder and those of its continuations, in their order; raises LogError if only some are simulated."""
        later = sorted(self.path.glob("part-*"), key=lambda part: int(part.name.rpartition("-")[2]))
        parts = [self, *(RunFolder(part) for part in later)]
        simulated = {part.path: part.rehearsal is not None for part in parts if later and part.began}
        if len(set(simulated.values())) > 1:
            names = ", ".join(str(path) for path, is_simulated in simulated.items() if is_simulated)
            raise LogError(
                f"{self.path}: holds simulated and measured parts, which are never joined: {names} is of a rehearsal; "
                "move what does not belong here into a folder of its own"
            )
        return parts

    @property
    def next_part(self) -> Path:
        """The folder of the next continuation; not made yet."""
        return self.path / f"part-{len(self.parts) + 1}"

    @property
    def tables(self) -> list[EstimatesTable]:
        """The tables of estimates, those made afterwards first, since they know more; raises LogError."""
        return [table for name in (OFFLINE, ONLINE) if (table := self._table(name)) is not None]

    @property
    def online_table(self) -> EstimatesTable | None:
        """The table of estimates that was written while the run went on, if there is one; raises LogError."""
        return self._table(ONLINE)

    def _table(self, name: str) -> EstimatesTable | None:
        """Return the table of a name in the form that it has; a stream of Arrow next to Parquet was to be deleted."""
        paths = (self.path / f"{name}{suffix}" for suffix in (TEXT, WHOLE, STREAM))
        path = next((path for path in paths if path.is_file()), None)
        if path is None:
            return None
        return _read(path) if path.suffix == TEXT else EstimatesTable(path, *read_columns(path))

    @property
    def tracks(self) -> dict[str, TrackTable]:
        """The estimates of every track by its name, offline ones first."""
        tracks: dict[str, TrackTable] = {}
        for table in self.tables:
            tracks |= {name: table.track(name) for name in table.tracks if name not in tracks}
        return tracks

    @property
    def places(self) -> tuple[Floats, Floats]:
        """Times (n,) [s] of the table of estimates, if any, and where the tip was (n, 2) [m]; raises LogError."""
        table = self.online_table
        numbers = np.zeros((0, 3)) if table is None else table.numbers
        return (numbers[:, 0], numbers[:, 1:3]) if len(numbers) else (np.zeros(0), np.zeros((0, 2)))


def _read(path: Path) -> EstimatesTable:
    """Return the table of a file of estimates, without a last line that is cut; raises LogError."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            names = next(csv.reader(file), [])
            lines = [line for line in file if line.count(",") == len(names) - 1 and line.endswith("\n")]
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read: {_reason(error)}") from error
    try:
        numbers = _numbers("".join(lines), len(names)) if lines and names else np.zeros((0, len(names)))
    except ValueError as error:
        raise LogError(f"{path}: is not a table of numbers: {error}") from error
    return EstimatesTable(path, tuple(names), numbers)


def _text(path: Path) -> str:
    try:
        return bounded_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read: {_reason(error)}") from error


def _reason(error: OSError | UnicodeDecodeError) -> str:
    return str(error.strerror) if isinstance(error, OSError) else "not UTF-8 text"


def _numbers(text: str, columns: int) -> Floats:
    """Return rows of numbers (n, columns), NaN where a cell is empty."""
    for _ in range(2):  # neighbouring empty cells share a comma
        text = text.replace(",,", ",nan,")
    text = text.replace(",\n", ",nan\n").replace("\n,", "\nnan,")
    return np.loadtxt(
        io.StringIO(f"nan{text}" if text.startswith(",") else text), delimiter=",", ndmin=2, comments=None
    )
