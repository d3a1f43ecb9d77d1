"""The table of many curves: each is a row, with the uncertainty and the verdict of a fit of its own."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, OutputError
from palpate.host import Pipeline, resolved_text, write_whole
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.terminal.progress import report_progress

from palpate_fits.curve_fits import CurveReader, Row, value_units
from palpate_fits.curve_pool import on_cores
from palpate_fits.curves import Curve
from palpate_fits.file_pipelines import SETTINGS

TABLE = "fits.csv"
_HEAD, _KINDS = ("curve", "track"), ("", "_std", "_combined")
_TAIL = ("rms", "samples", "x", "y", "verdict", "flags", "error")


class FitTable:
    """``fits.csv``: written curve by curve, and gone on with where it ends."""

    def __init__(self, folder: Path, pipeline: Pipeline, device: str, settings: str = SETTINGS) -> None:
        names = [*dict.fromkeys(name for track in pipeline.tracks for name in value_units(track.model)), "surface"]
        self.names = tuple(names)
        self.columns = (*_HEAD, *(f"{name}{kind}" for name in names for kind in _KINDS), *_TAIL)
        self._tracks = len(pipeline.tracks)
        self.path = folder / TABLE
        self._settle(folder, pipeline, device, folder / settings)
        self.done = self._whole() if self.path.exists() else set[str]()
        if not self.path.exists():
            write_whole(self.path, self._text([dict(zip(self.columns, self.columns, strict=True))]))

    def _settle(self, folder: Path, pipeline: Pipeline, device: str, settings: Path) -> None:
        """Begin a folder, or go on with one that was begun with the same settings; raises OutputError."""
        text = resolved_text(pipeline)
        ignored = {*pipeline.registry.tables, f"device.{device}.file"}
        if not settings.exists():
            more = settings.name != SETTINGS and self.path.exists()  # of files that are read in another way
            if not more and folder.exists() and any(folder.iterdir()):
                raise OutputError(f"{folder}: is not empty, and holds no fits to go on with")
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(settings, text)
        elif told := differences(text, settings.read_text(encoding="utf-8"), ignored):
            raise OutputError(f"{folder}: was begun with other settings: {told}; nothing is mixed: give --out another")

    def _whole(self) -> set[str]:
        """Names of the curves that have all their rows; what is behind the last of them, torn in writing, is cut."""
        found: set[str] = set()
        name, count, end = "", 0, 0
        with self.path.open("r+b") as file:
            if file.readline().decode().strip().split(",") != list(self.columns):
                raise OutputError(
                    f"{self.path}: has the columns of another version; nothing is mixed: give --out another"
                )
            end = file.tell()
            for line in iter(file.readline, b""):
                if not line.endswith(b"\n"):
                    break
                cells = next(csv.reader([line.decode()]))
                count = count + 1 if cells[0] == name else 1
                name = cells[0]
                if count == self._tracks or (cells[-1] and not cells[1]):
                    found.add(name)
                    end = file.tell()
            file.truncate(end)
        return found

    def _text(self, rows: Iterable[Mapping[str, str]]) -> str:
        text = io.StringIO()
        csv.DictWriter(text, self.columns, lineterminator="\n").writerows(rows)
        return text.getvalue()

    def add(self, rows: Sequence[Row]) -> None:
        """The rows of one curve, in one writing."""
        lines = [{key: " ".join(value.split()) for key, value in row.items()} for row in rows]
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                file.write(self._text(lines))
        except OSError as error:
            raise OutputError(f"{self.path}: cannot write: {error.strerror}") from error

    @property
    def rows(self) -> list[Row]:
        """Every row by column, as text."""
        with self.path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def summary(self) -> dict[str, dict[str, Any]]:
        """By track: curves, those that failed or are flagged, and median and quartiles of each parameter."""
        found: dict[str, dict[str, Any]] = {}
        numbers: dict[str, dict[str, list[float]]] = {}
        for row in self.rows:
            told = found.setdefault(row["track"], {"curves": 0, "failed": 0, "flagged": 0})
            told["curves"] += 1
            told["failed"] += bool(row["error"]) or not row["surface"]
            told["flagged"] += row["verdict"] in ("doubtful", "invalid")
            for name in self.names[:-1]:
                if row[name]:
                    numbers.setdefault(row["track"], {}).setdefault(name, []).append(float(row[name]))
        for track, columns in numbers.items():
            found[track]["quartiles"] = {name: _quartiles(np.array(values)) for name, values in columns.items()}
        return found


def _quartiles(values: Floats) -> list[float]:
    return [float(value) for value in np.quantile(values, [0.25, 0.5, 0.75])]


def fit_each(
    pipeline: Pipeline, reader: CurveReader, curves: Iterable[Curve], folder: Path, workers: int | None = None
) -> FitTable:
    """Fit every curve that has no row yet, and append its rows."""
    table = FitTable(folder, pipeline, reader.device)
    left = (curve for curve in curves if curve.name not in table.done)
    found = len(table.done)
    for count, rows in enumerate(on_cores(reader, left, workers or len(os.sched_getaffinity(0))), start=found + 1):
        table.add(rows)
        report_progress(count)
    return table
