"""The table of many curves: each is a row, with the uncertainty and the verdict of a fit of its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError, OutputError
from palpate.host import Pipeline, resolved_text, write_whole

from palpate_kit.curves.curve_files import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, value_units
from palpate_kit.runs.pipeline_diff import differences

TABLE, SETTINGS = "fits.csv", "pipeline.toml"
_HEAD, _KINDS = ("curve", "track"), ("", "_std", "_combined")
_TAIL = ("rms", "samples", "x", "y", "verdict", "conditions", "needs", "flags", "settings", "error")
_LATER = ("conditions", "needs")  # columns that tables before schema 5 lack, as they lack the verdict of each value


class FitTable:
    """``fits.csv``: written curve by curve, and gone on with where it ends; the latest rows of a curve count."""

    def __init__(self, folder: Path, pipeline: Pipeline, device: str, settings: str = SETTINGS) -> None:
        self.columns = columns_of_fits(pipeline)
        self.names = tuple(name.removesuffix("_std") for name in self.columns if name.endswith("_std"))
        self._tracks = len(pipeline.tracks)
        self.path = folder / TABLE
        self._settle(folder, pipeline, device, folder / settings)
        self.settings = (folder / settings).read_text(encoding="utf-8")
        self.done = self._whole() if self.path.exists() else dict[str, str]()
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

    def _whole(self) -> dict[str, str]:
        """The settings of each curve that has all its rows; what is behind the last of them, torn, is cut."""
        found: dict[str, str] = {}
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
                count = count + 1 if cells[0] == name and count < self._tracks else 1
                name = cells[0]
                if count == self._tracks or (cells[-1] and not cells[1]):
                    found[name] = cells[-2]
                    end = file.tell()
            file.truncate(end)
        return found

    def left(self, curves: Iterable[Curve], reader: CurveReader) -> Iterable[Curve]:
        """The curves that have no rows by their present settings."""
        return (curve for curve in curves if self.done.get(curve.name) != reader.key(curve.own))

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
        """The latest rows of every curve by column, as text."""
        return latest_rows(self.path)

    def compact(self, names: Sequence[str] = ()) -> None:
        """Write the table anew where it holds rows that later ones stand for, or not in the order of the names."""
        known = self.rows
        places = {name: place for place, name in enumerate(names)}
        rows = sorted(known, key=lambda row: places.get(row["curve"], len(places)))
        with self.path.open("rb") as file:
            lines = sum(1 for _ in file) - 1
        if lines > len(rows) or rows != known:
            write_whole(self.path, self._text([dict(zip(self.columns, self.columns, strict=True)), *rows]))

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


def replace_columns(path: Path, columns: Sequence[str]) -> None:
    """Write a table of fits anew with other columns; a cell of one that is new is empty."""
    rows = latest_rows(path)
    text = io.StringIO()
    table = csv.DictWriter(text, columns, lineterminator="\n", restval="", extrasaction="ignore")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue())


def columns_of_fits(pipeline: Pipeline) -> tuple[str, ...]:
    """The columns of a table of the fits of a pipeline."""
    names = [*dict.fromkeys(name for track in pipeline.tracks for name in value_units(track.model)), "surface"]
    return _columns(names)


def _columns(names: Sequence[str]) -> tuple[str, ...]:
    """Every value with its uncertainties and its verdict, but for the surface, which has none."""
    of_values = [f"{name}{kind}" for name in names for kind in (*_KINDS, *(["_verdict"] if name != names[-1] else []))]
    return (*_HEAD, *of_values, *_TAIL)


def demand_columns(path: Path) -> None:
    """Raise LogError for a table of fits that another version has written, or that is none."""
    with path.open(encoding="utf-8", newline="") as file:
        head = tuple(next(csv.reader(file), ()))
    names = [name.removesuffix("_std") for name in head if name.endswith("_std")]
    now = _columns(names)
    if head not in (now, tuple(name for name in now if name not in _LATER and not name.endswith("_verdict"))):
        about = "was written by another version of palpate" if head[:1] == _HEAD[:1] else "is no table of fits"
        raise LogError(f"{path}: {about}: fit the curves again with another --out")


def latest_rows(path: Path) -> list[Row]:
    """The rows of a table of fits, of each curve those that were written last, in the order of the first."""
    with path.open(encoding="utf-8", newline="") as file:
        rows: dict[str, dict[str, Row]] = {}
        for row in csv.DictReader(file):
            if row.get("error") is not None:  # a line torn in writing has fewer cells
                of_curve = rows.setdefault(row["curve"], {})
                old = next(iter(of_curve.values()), row)
                if not row["track"] or not old["track"] or old.get("settings") != row.get("settings"):
                    of_curve.clear()
                of_curve[row["track"]] = row
    return [row for of_curve in rows.values() for row in of_curve.values()]
