"""Curves of JPK files: a zip of whole numbers by channel, and of properties that state their scales.

A map has a folder for each curve, with its place; what curves share is written once, and replaced by its number.
Layout: the properties in the files themselves, as afmformats describes it.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from palpate import Floats, LogError

from palpate_logs.force_curve import (
    BEFORE,
    FORCE,
    MEASURED,
    PIEZO,
    REST,
    SEGMENT,
    TIME,
    WAY_IN,
    WAY_OUT,
    ForceCurve,
    positive,
)

SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series")
FORMAT = "JPK Instruments"
_SEGMENT = re.compile(r"(?:index/(\d+)/)?segments/(\d+)/segment-header\.properties")
_CURVE = re.compile(r"index/(\d+)/")
_HEADER, _SHARED = "header.properties", "shared-data/header.properties"
_KINDS = ("force-scan-map", "force-scan-series", "quantitative-imaging-map", "quantitative-imaging-series")
_CHANNELS = {  # by column: names of its channel, the calibration whose numbers count, their unit
    FORCE: (("vDeflection",), "force", "N"),
    MEASURED: (("strainGaugeHeight", "capacitiveSensorHeight", "measuredHeight"), "nominal", "m"),
    PIEZO: (("height", "head-height"), "calibrated", "m"),
}
_ENCODERS = {  # of whole numbers, the highest byte first
    "signedshort": ">i2", "unsignedshort": ">u2", "signedinteger": ">i4", "unsignedinteger": ">u4", "signedlong": ">i8",
}  # fmt: skip
_SPRING = "channel.vDeflection.conversion-set.conversion.force.scaling.multiplier"
_HEAD = "force-segment-header."
_DURATION = f"{_HEAD}settings.segment-settings.duration"
_MAX_CALIBRATIONS = 8  # of a channel, one upon the other: two are usual
Properties = Mapping[str, str]


@dataclass(frozen=True)
class JpkFile:
    """An open file of JPK."""

    path: Path
    archive: zipfile.ZipFile
    segments: Mapping[int, Sequence[str]]  # folders of the segments of each curve
    channels: Mapping[str, Sequence[str]]  # names of the channels in each of these

    @property
    def format(self) -> str:
        """The maker."""
        return FORMAT

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the curves, ascending: not all need be there."""
        return tuple(self.segments)

    def curve(self, number: int) -> ForceCurve:
        """Return a curve; raises LogError where its properties are damaged."""
        name = f"{self.path}: curve {number}" if len(self.segments) > 1 else str(self.path)
        folders = self.segments[number]
        if not folders:
            raise LogError(f"{name}: has no segment")
        try:
            tables = [self._segment(folder) for folder in folders]
            ways = segment_ways([table[f"{_HEAD}settings.style"] for table in tables])
            entry = next((table for table, way in zip(tables, ways, strict=True) if way == WAY_IN), tables[0])
            duration = positive(float(entry[_DURATION])) if _DURATION in entry else None
            spring = positive(float(tables[0][_SPRING])) if _SPRING in tables[0] else None
        except (KeyError, ValueError, OSError, zipfile.BadZipFile) as error:
            raise LogError(f"{name}: its properties cannot be read: {_words(error)}") from error
        channels = {channel for folder in folders for channel in self.channels.get(folder, ())}
        columns = [column for column, (names, *_) in _CHANNELS.items() if channels & {*names}]
        reader = _SegmentReader(self.archive, folders, tables, self.channels)
        return ForceCurve(name, (*columns, SEGMENT, TIME), reader.read, ways, spring, duration)

    def place(self, number: int) -> tuple[float, float] | None:
        """Return x and y [m] of a curve of a map; None where its file does not state them."""
        try:
            table = self._properties(f"index/{number}/{_HEADER}")
            places = [[float(table[f"{kind}.header.position.{axis}"]) for axis in "xy"]
                      for kind in _KINDS if f"{kind}.header.position.x" in table]  # fmt: skip
        except (KeyError, ValueError, OSError, zipfile.BadZipFile):
            return None
        return (places[0][0], places[0][1]) if places and np.isfinite(places[0]).all() else None

    def _segment(self, folder: str) -> dict[str, str]:
        """Return the properties of a segment, with those that it shares with others in place of their number."""
        table = self._properties(f"{folder}segment-header.properties")
        for key in [key for key in table if key.endswith(".*")]:
            # channel.height.lcd-info.* = 2: lcd-info.2.x is channel.height.x
            head, _, list_name = key.removesuffix(".*").rpartition(".")
            shared = self._shared.get(f"{list_name}.{table[key]}", {})
            table |= {f"{head}.{name}": text for name, text in shared.items()}
        return table

    @cached_property
    def _shared(self) -> dict[str, dict[str, str]]:
        """Shared properties by the list and the number in it, as in "lcd-info.2"."""
        grouped: dict[str, dict[str, str]] = {}
        try:
            table = self._properties(_SHARED)
        except KeyError:  # of a single curve
            return grouped
        for key, text in table.items():
            list_name, number, name = (*key.split(".", 2), "", "")[:3]
            grouped.setdefault(f"{list_name}.{number}", {})[name] = text
        return grouped

    def _properties(self, entry: str) -> dict[str, str]:
        """Return the properties of an entry of the archive."""
        lines = self.archive.read(entry).decode("utf-8", "replace").splitlines()
        pairs = (line.partition("=") for line in map(str.strip, lines) if line and line[0] not in "#!")
        return {key.strip(): text.strip() for key, _, text in pairs}


@dataclass(frozen=True)
class _SegmentReader:
    """The columns of one curve, segment by segment."""

    archive: zipfile.ZipFile
    folders: Sequence[str]
    tables: Sequence[Properties]
    channels: Mapping[str, Sequence[str]]

    def read(self, column: str) -> Floats:
        """(n,) of all segments [SI]; raises KeyError, ValueError for properties that are missing or damaged."""
        counts = [int(float(table[f"{_HEAD}num-points"])) for table in self.tables]
        if column == SEGMENT:
            return np.repeat(np.arange(len(counts), dtype=float), counts)
        if column == TIME:
            durations = [float(table[f"{_HEAD}duration"]) for table in self.tables]
            starts = np.concatenate([[0.0], np.cumsum(durations)])
            parts = [
                np.linspace(start, start + duration, count, endpoint=False)
                for start, duration, count in zip(starts, durations, counts, strict=False)
            ]
            return np.concatenate(parts)
        values = [self._channel(column, k) for k in range(len(self.folders))]
        if [len(part) for part in values] != counts:
            raise ValueError(f"{sum(map(len, values))} readings are there, and {sum(counts)} are stated")
        return np.concatenate(values)

    def _channel(self, column: str, segment: int) -> Floats:
        """(n,) of one segment [SI]: whole numbers, each calibration upon the one that it is based on."""
        names, slot, unit = _CHANNELS[column]
        folder, table = self.folders[segment], self.tables[segment]
        name = next((name for name in self.channels.get(folder, ()) if name in names), None)
        if name is None:
            raise ValueError(f"no channel {' or '.join(names)} in segment {segment}")
        head = f"channel.{name}."
        encoder = f"{head}data.encoder." if f"{head}data.encoder.type" in table else f"{head}encoder."
        number_type = table[f"{encoder}type"]
        if number_type not in _ENCODERS:
            raise ValueError(f"numbers of type {number_type} are not read")
        numbers = np.frombuffer(self.archive.read(f"{folder}channels/{name}.dat"), np.dtype(_ENCODERS[number_type]))
        values = _scaled(numbers.astype(float), table, f"{encoder}scaling.")
        base, conversions = table[f"{head}conversion-set.conversions.base"], f"{head}conversion-set.conversion."
        # From the calibration that counts down to the numbers, then applied in the opposite order.
        chain: list[str] = []
        while slot != base and len(chain) < _MAX_CALIBRATIONS:
            below = f"{conversions}{slot}.base-calibration-slot"
            if below not in table:
                raise ValueError(f"{name} is not calibrated: the file states no {slot}")
            chain.append(f"{conversions}{slot}.")
            slot = table[below]
        for calibration in reversed(chain):
            values = _scaled(values, table, f"{calibration}scaling.")
        last = f"{chain[0]}scaling." if chain else f"{encoder}scaling."
        stated = next((text for key in ("unit.unit", "unit") if (text := table.get(f"{last}{key}"))), "no unit")
        if stated != unit:
            raise ValueError(f"is in {stated}, expected {unit}")
        return values


def jpk_file(path: Path) -> JpkFile:
    """Open a file; raises LogError where it is not one, or is cut off."""
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError) as error:
        with path.open("rb") as file:
            is_zip = file.read(2) == b"PK"
        reason = "it is cut off: the list of its curves is missing at its end; copy it again"
        raise LogError(
            f"{path}: cannot be read as a force curve of JPK: {reason if is_zip else 'it lacks the form of a zip'}"
        ) from error
    return JpkFile(path, archive, *_entries(archive.namelist()))


def _entries(names: Iterable[str]) -> tuple[dict[int, list[str]], dict[str, list[str]]]:
    """Return the folders of the segments of each curve, and the channels in each of these."""
    segments: dict[int, dict[int, str]] = {}
    channels: dict[str, list[str]] = {}
    for name in names:
        if match := _SEGMENT.fullmatch(name):
            folder = name.rpartition("/")[0] + "/"
            segments.setdefault(int(match[1] or 0), {})[int(match[2])] = folder
        elif name.endswith(".dat"):
            folder, _, channel = name.removesuffix(".dat").rpartition("channels/")
            channels.setdefault(folder, []).append(channel)
        elif match := _CURVE.match(name):
            segments.setdefault(int(match[1]), {})
    return {k: [folders[n] for n in sorted(folders)] for k, folders in sorted(segments.items())}, channels


def segment_ways(styles: Sequence[str]) -> tuple[float, ...]:
    """Return what each segment is by its style: the last way in before the first way out counts, pauses are rest."""
    first_out = styles.index("retract") if "retract" in styles else len(styles)
    entries = [k for k, style in enumerate(styles[:first_out]) if style == "extend"]
    way_in = entries[-1] if entries else -1
    return tuple(
        WAY_IN if k == way_in else BEFORE if k < way_in else WAY_OUT if k >= first_out else REST
        for k in range(len(styles))
    )


def _scaled(values: Floats, table: Properties, head: str) -> Floats:
    """Return values times the multiplier, plus the offset, of a scale."""
    return np.asarray(float(table[f"{head}multiplier"]) * values + float(table[f"{head}offset"]))


def _words(error: Exception) -> str:
    """Return what is missing or damaged."""
    return f"{error.args[0]} is missing" if isinstance(error, KeyError) else f"{type(error).__name__}: {error}"
