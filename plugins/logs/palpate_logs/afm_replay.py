"""Replay of a curve of an atomic force microscope: JPK's files, and any format that afmformats reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import (
    Batch,
    Channel,
    File,
    Floats,
    Frequency,
    Link,
    LogError,
    Stiffness,
    Stream,
)
from palpate_kit.logs.log_link import file_facts
from palpate_records.log_files import regular
from palpate_records.messages.readings import SECOND
from palpate_records.recording import Recording, Suggestion, Survey, TopicSurvey
from pydantic import Field

from palpate_logs.afm_suggestion import suggest_curve
from palpate_logs.curve_export import is_exported_curve
from palpate_logs.curve_file import CurveFile, curve_file, named_curve
from palpate_logs.force_curve import APPROACH, MEASURED, PIEZO, TIP_POSITION
from palpate_logs.jpk_curves import SUFFIXES as JPK

SUFFIXES = (*JPK, ".ibw")
_BATCH_READINGS = 4096  # in one batch, a choice: memory against calls
_MAX_LISTED = 12  # curves of a map that `info` reads, a choice: a screen
_UNITS = {"force": "N", "height": "m", "segment": "1", "approach": "1"}  # by channel
_HEIGHT_COLUMNS = {"tip": TIP_POSITION, "measured": MEASURED, "piezo": PIEZO}  # by the option `height`


class AfmReplay(Recording):
    """One curve of an atomic force microscope as a device: channels force [N], height [m], segment and approach.

    The height is that of the tip: the cantilever's, plus force over spring constant; or one of the columns as recorded.
    The segment is 0 on the way in, 1 on the way out, 2 at rest between, 3 before the way in, as the file has it; the
    approach is 1 on the way in, else 0. A map is a file of several records, its curves by their numbers, each at its
    place. The extra `palpate[afm]` brings afmformats, which knows files of Asylum and AFM workshop, HDF5 of its own,
    and exports of NT-MDT Nova and the Optics11 Chiaro.
    Source of the tip position: Cappella and Dietler 1999, as nanite and the makers' software have it.
    """

    file: File = Field(description="the log, such as .jpk-force, relative to the pipeline file")
    record: str | None = Field(
        default=None, description="number of the curve in a map, as in the file; left out: the first"
    )
    height: Literal["tip", "measured", "piezo"] = Field(
        default="tip", description='"tip": height (measured) plus force over spring constant; else a column as recorded'
    )
    spring_constant: Stiffness | None = Field(
        default=None, gt=0, description="of the cantilever; left out: the value in the file"
    )
    rate: Frequency | None = Field(default=None, gt=0, description="sampling rate, where the file contains no time")

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The only stream, which has no name: its channels are addressed as ``device.channel``."""
        regular(self.file)
        return (Stream("", tuple(Channel(name, unit) for name, unit in _UNITS.items()), None, clock="file"),)

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file, its SHA-256, and the curve."""
        facts = dict(file_facts(self.file, [self.file]))
        if self.record is not None:
            facts["record"] = self.record
        return facts

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Open the file."""
        yield _AfmLink(self)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True for a file that is named like a force curve."""
        if not path.is_file():
            return False
        return path.name.lower().endswith(SUFFIXES) or is_exported_curve(path)

    @classmethod
    def records(cls, path: Path, choices: Mapping[str, str]) -> tuple[str, ...]:
        """See `Recording`: the numbers of the curves of a map."""
        numbers = curve_file(path).numbers
        return tuple(map(str, numbers)) if len(numbers) > 1 else ()

    @classmethod
    def places(cls, path: Path) -> Mapping[str, tuple[float, float]]:
        """See `Recording`."""
        file = curve_file(path)
        places = {str(number): file.place(number) for number in file.numbers}
        return {name: place for name, place in places.items() if place is not None}

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`; each curve is a topic, of a map each of the first `_MAX_LISTED`."""
        file = curve_file(path)
        topics = tuple(_survey_topic(file, number) for number in file.numbers[:_MAX_LISTED])
        curve_count = len(file.numbers)
        notes: list[str] = []
        if curve_count > 1:
            limit = f"; the first {_MAX_LISTED} are listed" if curve_count > _MAX_LISTED else ""
            notes.append(f"a map of {curve_count} curves{limit}: palpate fit fits each, --curve 3 one of them")
        return Survey(path, "force curves", topics, tuple(notes))

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`; nothing is to be chosen but the rate, if the file contains no time."""
        return suggest_curve(path, choices)

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`; a curve without a time is left out, with a note."""
        file = curve_file(path)
        for number in file.numbers:
            curve = file.curve(number)
            time = curve.time()
            name = f"curve {number}"
            if time is not None:
                stamps = _stamps(time)
                readings = np.column_stack([curve.column(column) for column in curve.columns])
                yield name, curve.columns, Batch(name, stamps, stamps, readings)
            elif notes is not None:
                notes.append(f"{name} has no time, and is left out")


def _stamps(time: Floats) -> NDArray[np.int64]:
    """Return the time-stamps (n,) [ns] of times (n,) [s], from 0 at the first."""
    stamps: NDArray[np.int64] = np.rint((time - time[0]) * SECOND).astype(np.int64)
    return stamps


def _survey_topic(file: CurveFile, number: int) -> TopicSurvey:
    """Return the contents of a curve as those of a topic; of a damaged curve of a map the reason.

    Raises LogError for a file of one curve that is damaged.
    """
    name = f"curve {number}"
    try:
        curve = file.curve(number)
        time = curve.time()
        reading_count = len(curve.force)
    except LogError as error:
        if len(file.numbers) == 1:
            raise
        return TopicSurvey(name, type=file.format, encoding="afm", messages=0, first=0, last=0, note=str(error))
    if time is None:
        stamps = np.zeros(1, np.int64)
        interval = None
    else:
        stamps = _stamps(time)
        interval = _interval_percentiles(time)
    return TopicSurvey(
        name,
        type=file.format,
        encoding="afm",
        messages=reading_count,
        first=int(stamps[0]),
        last=int(stamps[-1]),
        interval=interval,
        fields=curve.columns,
        note="" if time is not None else "no time: give the device rate",
    )


def _interval_percentiles(time: Floats) -> tuple[float, float, float] | None:
    """Return percentiles 1, 50 and 99 of the intervals [s] between times (n,) [s]; None for a single time."""
    intervals = np.diff(time)
    if not len(intervals):
        return None
    low, median, high = np.percentile(intervals, (1, 50, 99)).tolist()
    return low, median, high


@dataclass(frozen=True)
class _AfmLink:
    """The open curve of a device."""

    log: AfmReplay

    def batches(self) -> Iterator[Batch]:
        """Yield the readings in their order, `_BATCH_READINGS` at a time: force, height, segment, approach."""
        path = self.log.file
        curve = named_curve(curve_file(path), path, self.log.record)
        time = curve.time(self.log.rate)
        if time is None:
            raise LogError(f"{path}: the file contains no time: set rate of the device")
        segment = curve.segment
        height = curve.height(_HEIGHT_COLUMNS[self.log.height], self.log.spring_constant)
        readings = np.column_stack([curve.force, height, segment, segment == APPROACH])
        stamps = _stamps(time)
        for first_row in range(0, len(stamps), _BATCH_READINGS):
            rows = slice(first_row, first_row + _BATCH_READINGS)
            yield Batch("", stamps[rows], stamps[rows], readings[rows])
