"""The log that the gauge's own program writes: its lines in a file ``.gauge``."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from palpate import Batch, File, Link, LogError, Stream
from palpate_records.recording import Recording, Suggestion, Survey, TopicSurvey
from pydantic import Field

from palpate_gauge.lines import CHANNELS, parse_line

NAMES = tuple(channel.name for channel in CHANNELS)


class GaugeLog(Recording):
    """A log of the gauge: channels force [N] and height [m]."""

    file: File = Field(description="the log, relative to the pipeline file")

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream without a name."""
        return (Stream("", CHANNELS, None, clock="gauge"),)

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        return {"file": str(self.file), "sha256": hashlib.sha256(self.file.read_bytes()).hexdigest()}

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """The open file."""
        yield _GaugeLink(self.file)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """By its ending."""
        return path.is_file() and path.suffix == ".gauge"

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """One topic."""
        batch = read_log(path)
        first, last = int(batch.time[0]), int(batch.time[-1])
        return Survey(
            path, "gauge", (TopicSurvey("gauge", "line", "text", len(batch.time), first, last, fields=NAMES),)
        )

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """The format knows which column is which."""
        alignment = {"force": {"channel": "log.force"}, "position": {"channel": "log.height"}, "tip_mass": "0 g"}
        reasons = ("force and height: as the format has them",)
        return Suggestion({"type": "gauge-log", "file": str(path)}, alignment, reasons, has_time=True)

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """The one topic."""
        yield "gauge", NAMES, read_log(path)


class _GaugeLink:
    def __init__(self, path: Path) -> None:
        self.path = path

    def batches(self) -> Iterator[Batch]:
        """All readings at once."""
        yield read_log(self.path)


def read_log(path: Path) -> Batch:
    """Return the readings of a log; raises LogError with the line that is damaged."""
    rows = []
    for number, line in enumerate(path.read_bytes().splitlines(), start=1):
        try:
            rows.append(parse_line(line))
        except ValueError as error:
            raise LogError(f"{path}, line {number}: is not a line of the gauge: {error}") from error
    if not rows:
        raise LogError(f"{path}: is empty")
    stamp = 1000 * np.array([row[0] for row in rows], np.int64)
    return Batch("", stamp, stamp, np.array([row[1:] for row in rows]))
