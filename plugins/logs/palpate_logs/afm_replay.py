"""Replay of a curve of an atomic force microscope: JPK's files, and any format that afmformats reads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

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
from palpate_kit.logs.suggestion import TIP
from palpate_records.log_files import regular
from palpate_records.recording import Recording, Suggestion, Survey, TopicSurvey
from pydantic import Field

from palpate_logs.curve_export import is_exported_curve
from palpate_logs.curve_file import CurveFile, curve_file, named_curve
from palpate_logs.force_curve import MEASURED, PIEZO, TIP_POSITION, WAY_IN, ForceCurve
from palpate_logs.jpk_curves import SUFFIXES as JPK

SUFFIXES = (*JPK, ".ibw")
_SECOND = 1e9  # [ns]
_BLOCK = 4096  # readings in one batch
_AIR = 0.3  # of the way down whose mean is the tare, at most
_ROUND = (5.0, 2.0, 1.0)  # digits of a duration that curves of a map share, though theirs differ a little
_LISTED = 12  # curves of a map that `info` reads
ANALYSIS = "afm-analysis"  # the template of tip, model and estimator
_CHANNELS = {"force": "N", "height": "m", "segment": "1", "approach": "1"}
_ROWS = {"tip": TIP_POSITION, "measured": MEASURED, "piezo": PIEZO}


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
        """One stream without a name: channels are addressed as ``device.channel``."""
        regular(self.file)
        return (Stream("", tuple(Channel(name, unit) for name, unit in _CHANNELS.items()), None, clock="file"),)

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file, its SHA-256, and the curve."""
        facts: Mapping[str, str] = file_facts(self.file, [self.file])
        return {**facts, **({} if self.record is None else {"record": self.record})}

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """The open file."""
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
        return {str(number): place for number in file.numbers if (place := file.place(number)) is not None}

    @classmethod
    def survey(cls, path: Path) -> Survey:
        """See `Recording`; every curve is a topic, of a map the first."""
        file = curve_file(path)
        topics = tuple(_topic(file, number) for number in file.numbers[:_LISTED])
        notes = list[str]()
        if len(file.numbers) > 1:
            listed = f"; the first {_LISTED} are listed" if len(file.numbers) > _LISTED else ""
            notes.append(f"a map of {len(file.numbers)} curves{listed}: palpate fit fits each, --curve 3 one of them")
        return Survey(path, "force curves", topics, tuple(notes))

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`; nothing is to be chosen but the rate, where the file holds no time."""
        file = curve_file(path)
        curve = _sound_curve(file, path, choices.get("record"))
        device: dict[str, Any] = {"type": "afm-replay", "file": str(path)}
        device |= {"record": choices["record"]} if "record" in choices else {}
        blanks, doubts = list[str](), list[str]()
        reasons = [f"force and height: those of {curve.name.removeprefix(f'{path}: ')}, as the format names them"]
        time = curve.time()
        if time is None and "rate" in choices:
            device["rate"] = choices["rate"]
        elif time is None:
            device["rate"] = "? Hz"
            blanks.append("rate: the file contains no time (or --rate '2 kHz')")
        if curve.spring_constant is None and TIP_POSITION not in curve.columns:
            device["spring_constant"] = "? N/m"
            blanks.append("spring_constant: the file does not state it")
        elif curve.spring_constant is not None:
            reasons.append(f"spring constant: {curve.spring_constant:.4g} N/m, as the file states it")
        roles = {"force": "force", "position": "height", "measuring": "approach"}
        alignment: dict[str, Any] = {role: {"channel": f"log.{name}"} for role, name in roles.items()}
        reasons.append("measuring: the way in, as the file has it")
        if time is not None and curve.duration is not None:
            alignment["tare_duration"] = f"{_round_down(_AIR * curve.duration):.3g} s"
            reasons.append(f"tare: the mean of up to {_AIR:.0%} of the approach, its first, which has to be in air")
        alignment["tip_mass"] = "0 g"
        if len(file.numbers) > 1 and "record" not in choices:
            doubts.append(
                f"the file holds {len(file.numbers)} curves, and the first is read: --set device.log.record=NUMBER"
            )
        if TIP not in choices:
            doubts.append("the tip: the file does not state its shape and size; state them in [indenter.tip]")
        return Suggestion(
            device, alignment, tuple(reasons), tuple(doubts), tuple(blanks), template=ANALYSIS,
            assumed=("model.*", "alignment.tare", "alignment.*.delay"), has_time=time is not None,
        )  # fmt: skip

    @classmethod
    def tables(cls, path: Path, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
        """See `Recording`; a curve without time is left out."""
        file = curve_file(path)
        for number in file.numbers:
            curve = file.curve(number)
            time = curve.time()
            if time is not None:
                name, stamps = f"curve {number}", _stamps(time)
                columns = np.column_stack([curve.column(key) for key in curve.columns])
                yield name, curve.columns, Batch(name, stamps, stamps, columns)
            elif notes is not None:
                notes.append(f"curve {number} has no time, and is left out")


def _round_down(seconds: float) -> float:
    """Return the longest of 1, 2, 5, 10, ... [s] that is not longer."""
    power = 10.0 ** math.floor(math.log10(seconds))
    return next((digit * power for digit in _ROUND if digit * power <= seconds * (1 + 1e-9)), power)


def _sound_curve(file: CurveFile, path: Path, name: str | None) -> ForceCurve:
    """Return a curve, or in place of a damaged one of a map the first that is not; raises LogError without any."""
    try:
        return named_curve(file, path, name)
    except LogError:
        for number in file.numbers if len(file.numbers) > 1 and (name is None or name.isdecimal()) else ():
            try:
                return file.curve(number)
            except LogError:
                continue
        raise


def _stamps(time: Floats) -> NDArray[np.int64]:
    stamps: NDArray[np.int64] = np.rint((time - time[0]) * _SECOND).astype(np.int64)
    return stamps


def _topic(file: CurveFile, number: int) -> TopicSurvey:
    """Return what a curve contains; of a damaged one why it cannot be read."""
    name = f"curve {number}"
    try:
        curve = file.curve(number)
        time, count = curve.time(), len(curve.force)
    except LogError as error:
        if len(file.numbers) == 1:
            raise
        return TopicSurvey(name, file.format, "afm", 0, 0, 0, note=str(error))
    stamps = _stamps(time) if time is not None else np.zeros(1, np.int64)
    steps = np.diff(time) if time is not None else np.zeros(0)
    low, middle, high = np.percentile(steps, (1, 50, 99)).tolist() if len(steps) else (0.0, 0.0, 0.0)
    return TopicSurvey(
        name, file.format, "afm", count, int(stamps[0]), int(stamps[-1]),
        (low, middle, high) if len(steps) else None, fields=curve.columns,
        note="" if time is not None else "no time: give the device rate",
    )  # fmt: skip


@dataclass(frozen=True)
class _AfmLink:
    log: AfmReplay

    def batches(self) -> Iterator[Batch]:
        """Yield the readings in their order, some thousand at a time."""
        path = self.log.file
        curve = named_curve(curve_file(path), path, self.log.record)
        time = curve.time(self.log.rate)
        if time is None:
            raise LogError(f"{path}: the file contains no time: set rate of the device")
        segment, height = curve.segment, curve.height(_ROWS[self.log.height], self.log.spring_constant)
        values = np.column_stack([curve.force, height, segment, segment == WAY_IN])
        stamps = _stamps(time)
        for begin in range(0, len(stamps), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            yield Batch("", stamps[rows], stamps[rows], values[rows])
