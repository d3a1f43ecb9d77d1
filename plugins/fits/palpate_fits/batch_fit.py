"""Many curves by one pipeline: each is fitted by itself and is a row of a table, which can be gone on with."""

from __future__ import annotations

import csv
import io
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from palpate import (
    Batch,
    ConfigurationError,
    Device,
    Estimates,
    Estimator,
    Flag,
    Floats,
    OutputError,
    PalpateError,
    Problem,
    Samples,
    Stream,
    Tracker,
    finite_rows,
)
from palpate.host import (
    Aligner,
    Pipeline,
    Ports,
    Source,
    Track,
    build_pipeline,
    inherited_approval,
    ports_of,
    resolved_text,
    verdict,
    write_whole,
)
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.terminal.progress import report_progress

from palpate_fits.estimator import CasadiFit
from palpate_fits.tracker import FitTracker

_TOGETHER = 16  # curves that a process is given at once
_AHEAD = 2  # portions that wait for each process: what is held in memory does not grow with the number of curves
TABLE, SETTINGS = "fits.csv", "pipeline.toml"
_HEAD, _TAIL = ("curve", "track"), ("surface", "surface_std", "rms", "samples", "x", "y", "flags", "error")

Row = dict[str, str]


@dataclass(frozen=True)
class CurveReader:
    """How curves are read and fitted, as plain data for any process."""

    text: str  # of the pipeline file
    path: str
    overrides: tuple[str, ...]
    device: str  # that has the file
    approved: frozenset[str] = frozenset()  # SHA-256 of the plugin files that any process may execute


@dataclass(frozen=True)
class Curve:
    """One curve: a file, or its readings."""

    name: str
    file: str = ""
    batches: tuple[Batch, ...] = ()


@dataclass(frozen=True)
class _Fits:
    """A pipeline's offline tracks in one process; a fit keeps what it has compiled from curve to curve."""

    pipeline: Pipeline
    fits: dict[int, Tracker]
    ports: dict[tuple[Stream, ...], Ports]

    def tracker(self, place: int, track: Track) -> Tracker:
        """A tracker that has seen nothing."""
        if place in self.fits:
            return self.fits[place]
        alignment = self.pipeline.alignment
        found = _for_a_row(track.estimator).start(
            Problem(track.model, alignment.tip_mass, alignment.timing_uncertainty)
        )
        if isinstance(found, FitTracker):  # which learns nothing
            found.brief = True
            self.fits[place] = found
        return found

    def samples(self, device: str, curve: Curve) -> Samples:
        """The samples of one curve; raises PalpateError where it cannot be read or holds none."""
        alignment, log = self.pipeline.alignment, self.pipeline.devices[device]
        if curve.file:
            log = log.model_copy(update={"file": Path(curve.file)})
        streams = log.streams
        if streams not in self.ports:  # files of one kind have the same
            self.ports.clear()
            self.ports[streams] = ports_of(alignment, {device: log})
        aligner = Aligner(alignment, self.ports[streams])
        with ExitStack() as stack:
            batches = curve.batches or stack.enter_context(log.connect(self.pipeline.run.seed)).batches()
            blocks = [aligner.aligned([(device, batch)], last) for batch, last in _told_last(batches)]
        return Samples.joined(blocks or [aligner.samples(final=True)])


def _for_a_row(estimator: Estimator) -> Estimator:
    """The estimator without what no column of the table shows and no flag is raised from."""
    if isinstance(estimator, CasadiFit):
        return estimator.model_copy(update={"profile": False, "bootstrap": 0})
    return estimator


@cache
def _fits(reader: CurveReader) -> _Fits:
    source = Source(reader.text, Path(reader.path))
    for assignment in reader.overrides:
        source.override(assignment)
    with inherited_approval(reader.approved):
        return _Fits(build_pipeline(source), {}, {})


def fit_curves(reader: CurveReader, curves: Sequence[Curve]) -> list[list[Row]]:
    """The rows of each curve, one for each offline track."""
    return [list(_rows(_fits(reader), reader.device, curve)) for curve in curves]


def _rows(fits: _Fits, device: str, curve: Curve) -> Iterator[Row]:
    pipeline = fits.pipeline
    tracks = [track for track in pipeline.tracks if not track.estimator.online]
    try:
        samples = fits.samples(device, curve)
    except PalpateError as error:
        yield from ({"curve": curve.name, "track": str(track.name), "error": str(error)} for track in tracks)
        return
    for place, track in enumerate(tracks):
        row = {"curve": curve.name, "track": str(track.name)}
        try:
            found = fits.tracker(place, track).run(samples)
        except Exception as error:  # one curve that breaks a model does not keep the others from their fit
            yield {
                **row,
                "error": str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}",
            }
            continue
        flags = pipeline.registry.judged(found.flags)
        yield row | _numbers(found, samples, [parameter.name for parameter in track.model.parameters], flags)


def _numbers(found: Estimates, samples: Samples, names: Sequence[str], flags: Sequence[Flag]) -> Row:
    rows = np.flatnonzero(finite_rows(found.values))
    table: dict[str, float] = {}
    if len(rows) and verdict(flags) != "invalid":
        last = int(rows[-1])
        for name, value, std in zip(names, found.values[last], found.std[last], strict=True):
            table |= {name: value, f"{name}_std": std}
        table |= {"surface": found.surface[last], "surface_std": found.surface_std[last]}
        if found.report is not None:
            table["rms"] = found.report.rms
        place = samples.lateral[rows]
        if np.isfinite(place).any():
            table |= dict(zip(("x", "y"), place[np.isfinite(place).all(axis=1)].mean(axis=0), strict=True))
    told = {name: f"{value:.10g}" for name, value in table.items() if np.isfinite(value)}
    return told | {"samples": str(len(rows)), "flags": " ".join(sorted({flag.code for flag in flags}))}


def _told_last(batches: Iterable[Batch]) -> Iterator[tuple[Batch, bool]]:
    """Batches, each with whether it is the last."""
    left = iter(batches)
    latest = next(left, None)
    while latest is not None:
        following = next(left, None)
        yield latest, following is None
        latest = following


def curve_files(sources: Sequence[Path], reader: type[Device]) -> Iterator[Curve]:
    """Every file that the reader recognises, of folders in the order of their names; raises ConfigurationError."""
    recognises = getattr(reader, "recognises", Path.is_file)
    found = 0
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: there is no such file or folder")
        for path in sorted(source.rglob("*")) if source.is_dir() else [source]:
            if not source.is_dir() or recognises(path):
                found += 1
                name = path.relative_to(source) if source.is_dir() and len(sources) == 1 else path
                yield Curve(str(name), str(path.resolve()))
    if not found:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that the pipeline could read")


def curves_by(logs: Iterable[Device], channel: str) -> Iterator[Curve]:
    """The curves of logs: a new one begins wherever a channel changes; one is held in memory at a time.

    Raises ConfigurationError where a log has no such channel, or several streams.
    """
    count = 0
    for log in logs:
        names = [known.name for known in log.streams[0].channels]
        if len(log.streams) != 1 or channel not in names:
            known = ", ".join(names)
            raise ConfigurationError(
                f"--by {channel}: the log must be one stream with that channel (there are: {known})"
            )
        with log.connect(0) as link:
            for batches in _split(link.batches(), names.index(channel)):
                yield Curve(f"{count}", batches=batches)
                count += 1


def _split(batches: Iterable[Batch], column: int) -> Iterator[tuple[Batch, ...]]:
    """Batches cut where a column changes, those of one value together."""
    waiting: list[Batch] = []
    for batch in batches:
        marks = batch.values[:, column]
        before = waiting[-1].values[-1, column] if waiting else marks[0]
        latest = np.maximum.accumulate(np.where(np.isfinite(marks), np.arange(len(marks)), -1))
        marks = np.where(latest < 0, before, marks[latest])  # a mark that is missing is no new one
        edges = np.flatnonzero(np.diff(marks, prepend=before) != 0).tolist()
        for first, last in pairwise([0, *edges, len(marks)]):
            if first in edges:
                yield tuple(waiting)
                waiting = []
            if last > first:
                rows = slice(first, last)
                waiting.append(Batch(batch.stream, batch.time[rows], batch.received[rows], batch.values[rows]))
    if waiting:
        yield tuple(waiting)


def on_cores(
    reader: CurveReader, curves: Iterable[Curve], workers: int, work: Callable[..., list[list[Row]]] = fit_curves
) -> Iterator[list[Row]]:
    """The rows of every curve in the order of the curves, however many processes there are.

    Where a process is killed, what was under way is done again one by one; a curve that kills that process, too, is
    told and left.
    """
    left = iter(curves)
    if workers <= 1:
        while portion := list(islice(left, _TOGETHER)):
            yield from work(reader, portion)
        return
    context = multiprocessing.get_context("spawn")  # forking a process with threads is asking for trouble
    waiting: deque[tuple[list[Curve], Future[list[list[Row]]]]] = deque()
    with ExitStack() as stack:
        pool = stack.enter_context(ProcessPoolExecutor(workers, mp_context=context))
        while True:
            while len(waiting) < _AHEAD * workers and (portion := list(islice(left, _TOGETHER))):
                waiting.append((portion, pool.submit(work, reader, portion)))
            if not waiting:
                return
            portion, future = waiting.popleft()
            try:
                yield from future.result()
            except BrokenProcessPool:
                doubtful = [curve for again in (portion, *(other for other, _ in waiting)) for curve in again]
                yield from _one_by_one(reader, doubtful, context, work)
                waiting.clear()
                pool = stack.enter_context(ProcessPoolExecutor(workers, mp_context=context))


def _one_by_one(
    reader: CurveReader, curves: Iterable[Curve], context: Any, work: Callable[..., list[list[Row]]]
) -> Iterator[list[Row]]:
    """Curves one after the other in one process, and in a new one after a curve that it does not survive."""
    left = deque(curves)
    while left:
        with ProcessPoolExecutor(1, mp_context=context) as pool:
            try:
                while left:
                    found = pool.submit(work, reader, [left[0]]).result()
                    left.popleft()
                    yield from found
            except BrokenProcessPool:
                yield [{"curve": left.popleft().name, "error": "its process was killed: is the memory enough?"}]


class FitTable:
    """``fits.csv``: written curve by curve, and gone on with where it ends."""

    def __init__(self, folder: Path, pipeline: Pipeline, device: str) -> None:
        names = dict.fromkeys(parameter.name for track in pipeline.tracks for parameter in track.model.parameters)
        self.columns = (*_HEAD, *(column for name in names for column in (name, f"{name}_std")), *_TAIL)
        self._tracks = len(pipeline.tracks)
        self.path = folder / TABLE
        self._settle(folder, pipeline, device)
        self.done = self._whole() if self.path.exists() else set[str]()
        if not self.path.exists():
            write_whole(self.path, self._text([dict(zip(self.columns, self.columns, strict=True))]))

    def _settle(self, folder: Path, pipeline: Pipeline, device: str) -> None:
        """Begin a folder, or go on with one that was begun with the same settings; raises OutputError."""
        settings, text = folder / SETTINGS, resolved_text(pipeline)
        ignored = {*pipeline.registry.tables, f"device.{device}.file"}
        if not settings.exists():
            if folder.exists() and any(folder.iterdir()):
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
            file.readline()
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

    def summary(self) -> dict[str, dict[str, Any]]:
        """By track: curves, those that failed or are flagged, and median and quartiles of each parameter."""
        found: dict[str, dict[str, Any]] = {}
        numbers: dict[str, dict[str, list[float]]] = {}
        with self.path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                told = found.setdefault(row["track"], {"curves": 0, "failed": 0, "flagged": 0})
                told["curves"] += 1
                told["failed"] += bool(row["error"]) or not row["surface"]
                told["flagged"] += bool(row["flags"])
                for name in self.columns[2 : -len(_TAIL)]:
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
