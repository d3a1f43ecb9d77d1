"""Replay of a curve of an atomic force microscope, in any format that afmformats reads."""

from __future__ import annotations

import logging
import warnings
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

SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series", ".ibw")
_SECOND = 1e9  # [ns]
_BLOCK = 4096  # readings in one batch
_AIR = 0.3  # of the way down whose mean is the tare
ANALYSIS = "afm-analysis"  # the template of tip, model and estimator
_CHANNELS = {"force": "N", "height": "m", "segment": "1", "approach": "1"}
_WAYS = (0.0, 1.0)  # in and out
_SEGMENTS = {"creep-compliance": (0.0, 2.0, 1.0), "stress-relaxation": (3.0, 0.0, 2.0, 1.0)}  # by afmformats' number
_ROWS = {"tip": "tip position", "measured": "height (measured)", "piezo": "height (piezo)"}


class AfmReplay(Recording):
    """One curve of an atomic force microscope as a device: channels force [N], height [m], segment and approach.

    The height is that of the tip: the cantilever's, plus force over spring constant; or one of the columns as recorded.
    The segment is 0 on the way in, 1 on the way out, 2 at rest between, 3 before the way in, as the file has it; the
    approach is 1 on the way in, else 0. The extra `palpate[afm]` brings afmformats, which knows files of JPK,
    Asylum and AFM workshop, and exports of NT-MDT Nova and the Optics11 Chiaro.
    Source of the tip position: Cappella and Dietler 1999, as nanite and the makers' software have it.
    """

    file: File = Field(description="the log, such as .jpk-force, relative to the pipeline file")
    curve: int = Field(default=0, ge=0, description="which curve of a map, counted from 0")
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
        return {**file_facts(self.file, [self.file]), "curve": str(self.curve)}

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
    def survey(cls, path: Path) -> Survey:
        """See `Recording`; every curve is a topic."""
        topics = []
        for i, curve in enumerate(_curves(path)):
            time = curve.time(None, path)
            stamps = _stamps(time) if time is not None else np.zeros(1, np.int64)
            steps = np.diff(time) if time is not None else np.zeros(0)
            interval = tuple(float(p) for p in np.percentile(steps, (1, 50, 99))) if len(steps) else None
            topics.append(
                TopicSurvey(
                    f"curve {i}", curve.format, "afm", len(curve.force), int(stamps[0]), int(stamps[-1]),
                    interval, fields=curve.columns,  # type: ignore[arg-type]
                    note="" if time is not None else "no time: give the device rate",
                )
            )  # fmt: skip
        return Survey(path, "force curves", tuple(topics))

    @classmethod
    def suggest(cls, path: Path, choices: Mapping[str, str]) -> Suggestion:
        """See `Recording`; nothing is to be chosen but the rate, where the file holds no time."""
        curve, *others = _curves(path)
        device: dict[str, Any] = {"type": "afm-replay", "file": str(path)}
        blanks, doubts, reasons = [], [], ["force and height: the first curve's, as the format names them"]
        time = curve.time(None, path)
        if time is None and "rate" in choices:
            device["rate"] = choices["rate"]
        elif time is None:
            device["rate"] = "? Hz"
            blanks.append("rate: the file contains no time (or --rate '2 kHz')")
        if curve.spring_constant is None and "tip position" not in curve.columns:
            device["spring_constant"] = "? N/m"
            blanks.append("spring_constant: the file does not state it")
        elif curve.spring_constant is not None:
            reasons.append(f"spring constant: {curve.spring_constant:.4g} N/m, as the file states it")
        roles = {"force": "force", "position": "height", "measuring": "approach"}
        alignment: dict[str, Any] = {role: {"channel": f"log.{name}"} for role, name in roles.items()}
        reasons.append("measuring: the way in, as the file has it")
        if time is not None and curve.duration is not None:
            alignment["tare_duration"] = f"{_AIR * curve.duration:.3g} s"
            reasons.append(f"tare: the mean of the first {_AIR:.0%} of the approach, which has to be in air")
        alignment["tip_mass"] = "0 g"
        if others and "curve" not in choices:
            doubts.append(
                f"the file holds {len(others) + 1} curves, and the first is read: --set device.log.curve=VALUE"
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
        for i, curve in enumerate(_curves(path)):
            time = curve.time(None, path)
            if time is not None:
                name, stamps = f"curve {i}", _stamps(time)
                columns = np.column_stack([curve.column(key) for key in curve.columns])
                yield name, curve.columns, Batch(name, stamps, stamps, columns)
            elif notes is not None:
                notes.append(f"curve {i} has no time, and is left out")


@dataclass(frozen=True)
class _AfmCurve:
    """One curve of a file."""

    data: Any  # of afmformats

    @property
    def columns(self) -> tuple[str, ...]:
        """Names as afmformats has them."""
        return tuple(self.data.columns)

    @property
    def force(self) -> Floats:
        """(n,) [N]."""
        return self.column("force")

    @property
    def format(self) -> str:
        """The maker's name of the format."""
        return str(self.data.metadata.get("format", "force curve"))

    @property
    def spring_constant(self) -> float | None:
        """[N/m]; None where the file does not state it."""
        value = self.data.metadata.get("spring constant", None)
        return float(value) if value is not None and np.isfinite(value) and value > 0 else None

    @property
    def duration(self) -> float | None:
        """Of the approach [s]."""
        value = self.data.metadata.get("duration approach", None)
        return float(value) if value is not None and np.isfinite(value) and value > 0 else None

    @property
    def segment(self) -> Floats:
        """(n,) 0 on the way in, 1 on the way out, 2 between, 3 before; 0 throughout where the file does not say it."""
        if "segment" not in self.columns:
            return np.zeros(len(self.force))
        meanings = _SEGMENTS.get(str(self.data.metadata.get("imaging mode")), _WAYS)
        return np.take(np.asarray(meanings), self.column("segment").astype(int), mode="clip")

    def column(self, name: str) -> Floats:
        """(n,) as recorded; raises LogError where that is damaged."""
        try:
            return np.asarray(self.data[name], np.float64)
        except Exception as error:  # read now, not when the file was opened: unpacked, scaled, put together
            raise LogError(f"{self.data.path}: its {name} cannot be read: {type(error).__name__}: {error}") from error

    def time(self, rate: float | None, path: Path) -> Floats | None:
        """(n,) [s] that advances from every reading to the next; None where neither file nor `rate` gives it.

        Raises LogError where the file contains a time as well.
        """
        if "time" not in self.columns:
            return None if rate is None else np.arange(len(self.force)) / rate
        if rate is not None:
            raise LogError(f"{path}: the file contains a time: leave out rate of the device")
        time = self.column("time")
        if not np.isfinite(time).all() or np.any(np.diff(time) <= 0):
            raise LogError(f"{path}: the time of the curve does not advance from every reading to the next")
        return time


def _curves(path: Path) -> list[_AfmCurve]:
    """Return every curve of a file; raises LogError where afmformats is missing or does not read it."""
    regular(path)
    try:
        with warnings.catch_warnings():  # of its own dependencies; what matters is raised
            warnings.simplefilter("ignore")
            import afmformats

            logging.getLogger("afmformats").addHandler(logging.NullHandler())  # which else prints a traceback
    except ImportError as error:
        raise LogError(f"{path}: force curves need afmformats: pip install 'palpate[afm]'") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = [_AfmCurve(data) for data in afmformats.load_data(path)]
            for curve in found:
                if "force" not in curve.columns:
                    raise LogError(f"{path}: contains no force (there are: {', '.join(curve.columns)})")
    except (LogError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # of a parser, for files that are damaged; its own derive from nothing narrower
        if type(error).__name__ == "FileFormatNotSupportedError":
            raise LogError(f"{path}: is not a force curve that afmformats knows: export it as text") from error
        raise LogError(f"{path}: cannot be read as a force curve: {type(error).__name__}: {error}") from error
    if not found:
        raise LogError(f"{path}: contains no force curve")
    return found


def _stamps(time: Floats) -> NDArray[np.int64]:
    stamps: NDArray[np.int64] = np.rint((time - time[0]) * _SECOND).astype(np.int64)
    return stamps


@dataclass(frozen=True)
class _AfmLink:
    log: AfmReplay

    def batches(self) -> Iterator[Batch]:
        """Yield the readings in their order, some thousand at a time."""
        curves, path = _curves(self.log.file), self.log.file
        if self.log.curve >= len(curves):
            raise LogError(f"{path}: no curve {self.log.curve}; it contains {len(curves)}, 0 to {len(curves) - 1}")
        curve = curves[self.log.curve]
        time = curve.time(self.log.rate, path)
        if time is None:
            raise LogError(f"{path}: the file contains no time: set rate of the device")
        segment = curve.segment
        values = np.column_stack([curve.force, self._height(curve), segment, segment == 0])
        stamps = _stamps(time)
        for begin in range(0, len(stamps), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            yield Batch("", stamps[rows], stamps[rows], values[rows])

    def _height(self, curve: _AfmCurve) -> Floats:
        path, wanted = self.log.file, _ROWS[self.log.height]
        if wanted in curve.columns:
            return curve.column(wanted)
        if self.log.height != "tip":
            raise LogError(f"{path}: holds no {wanted!r} (there are: {', '.join(curve.columns)})")
        stiffness = self.log.spring_constant or curve.spring_constant
        if stiffness is None:
            raise LogError(f"{path}: does not state its spring constant: set spring_constant of the device")
        base = next((name for name in (_ROWS["measured"], _ROWS["piezo"]) if name in curve.columns), None)
        if base is None:
            raise LogError(f"{path}: contains no height (there are: {', '.join(curve.columns)})")
        return curve.column(base) + curve.force / stiffness
