"""Curves of files, and of parts of a log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from palpate import Batch, ConfigurationError, Device
from palpate_kit.curves.alike_logs import log_paths
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_list import is_list


def curve_files(sources: Sequence[Path], reader: type[Device]) -> Iterator[Curve]:
    """Yield every file that the reader recognises, of folders in the order of their names; raises
    ConfigurationError."""
    recognises = getattr(reader, "recognises", Path.is_file)
    count = 0
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: no such file or folder")
        for path in log_paths(source, recognises) if source.is_dir() else [source]:
            if is_list(path):
                continue
            count += 1
            name = path.relative_to(source) if path != source and len(sources) == 1 else path
            yield Curve(str(name), str(path.resolve()))
    if not count:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that the pipeline could read")


def curves_by(logs: Iterable[Device], channel: str) -> Iterator[Curve]:
    """Yield the curves of logs: a new one begins wherever a channel changes; one is held in memory at a time.

    Raises ConfigurationError where a log has no such channel, or several streams.
    """
    count = 0
    for log in logs:
        names = [entry.name for entry in log.streams[0].channels]
        if len(log.streams) != 1 or channel not in names:
            raise ConfigurationError(
                f"--by {channel}: the log must be one stream with that channel (there are: {', '.join(names)})"
            )
        with log.connect(0) as link:  # a seed, which a log does not use
            for batches in _split(link.batches(), names.index(channel)):
                yield Curve(f"{count}", batches=batches)
                count += 1


def _split(batches: Iterable[Batch], column: int) -> Iterator[tuple[Batch, ...]]:
    """Yield batches cut where the mark in a column changes, those of one mark together.

    A missing mark changes nothing.
    """
    waiting: list[Batch] = []
    latest_mark = np.nan  # none is known yet
    for batch in batches:
        marks = batch.values[:, column]
        if not len(marks):
            continue
        # A missing mark is the latest one that is known; what comes before the first one changes nothing.
        latest = np.maximum.accumulate(np.where(np.isfinite(marks), np.arange(len(marks)), -1))
        marks = np.where(latest < 0, latest_mark, marks[latest])
        previous = np.concatenate([[latest_mark], marks[:-1]])
        edges = np.flatnonzero((marks != previous) & np.isfinite(previous)).tolist()
        begin = 0
        for end in (*edges, len(marks)):
            if end > begin:
                rows = slice(begin, end)
                waiting.append(Batch(batch.stream, batch.time[rows], batch.received[rows], batch.values[rows]))
            if end < len(marks):
                yield tuple(waiting)
                waiting = []
            begin = end
        latest_mark = marks[-1]
    if waiting:
        yield tuple(waiting)
