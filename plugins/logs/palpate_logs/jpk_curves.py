"""Curves of JPK files: a zip of whole numbers by channel, and of properties that state their scales.

Entries of the archive::

    header.properties
    shared-data/header.properties                       properties that segments share, each list by its number
    segments/S/segment-header.properties                of segment S of the only curve: samples, scales, styles
    segments/S/channels/NAME.dat                        whole numbers of a channel, the highest byte first
    index/C/header.properties, index/C/segments/S/...   the same of curve C of a map, with its place

Source: the properties in the files themselves, as afmformats reads them.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from palpate import LogError

from palpate_logs.force_curve import (
    APPROACH,
    BEFORE_APPROACH,
    PAUSE,
    RETRACT,
    SEGMENT,
    TIME,
    ForceCurve,
    positive,
)
from palpate_logs.jpk_channels import CHANNELS, SEGMENT_HEADER, Properties, SegmentReader

SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series")
FORMAT = "JPK Instruments"
_SEGMENT_ENTRY = re.compile(r"(?:index/(\d+)/)?segments/(\d+)/segment-header\.properties")  # curve, segment
_CURVE_ENTRY = re.compile(r"index/(\d+)/")
_HEADER, _SHARED_HEADER = "header.properties", "shared-data/header.properties"
_MAP_KINDS = ("force-scan-map", "force-scan-series", "quantitative-imaging-map", "quantitative-imaging-series")
_SPRING_CONSTANT = "channel.vDeflection.conversion-set.conversion.force.scaling.multiplier"
_DURATION = f"{SEGMENT_HEADER}settings.segment-settings.duration"


@dataclass(frozen=True)
class JpkFile:
    """An open file of JPK."""

    path: Path
    archive: zipfile.ZipFile
    segments: Mapping[int, Sequence[str]]  # folders of the segments of each curve
    channels: Mapping[str, Sequence[str]]  # names of the channels in each of these

    @property
    def format(self) -> str:
        """The name of the maker."""
        return FORMAT

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the curves, ascending; there may be gaps."""
        return tuple(self.segments)

    def curve(self, number: int) -> ForceCurve:
        """Return a curve; raises LogError where its properties are damaged."""
        name = f"{self.path}: curve {number}" if len(self.segments) > 1 else str(self.path)
        folders = self.segments[number]
        if not folders:
            raise LogError(f"{name}: has no segment")
        try:
            tables = [self._segment_properties(folder) for folder in folders]
            kinds = segment_kinds([table[f"{SEGMENT_HEADER}settings.style"] for table in tables])
            approach = tables[kinds.index(APPROACH)] if APPROACH in kinds else tables[0]
            approach_duration = _positive_number(approach, _DURATION)
            spring_constant = _positive_number(tables[0], _SPRING_CONSTANT)
        except (KeyError, ValueError, OSError, zipfile.BadZipFile) as error:
            raise LogError(f"{name}: its properties cannot be read: {_reason(error)}") from error
        channels = {channel for folder in folders for channel in self.channels.get(folder, ())}
        columns = [column for column, (names, *_) in CHANNELS.items() if channels & {*names}]
        return ForceCurve(
            name,
            columns=(*columns, SEGMENT, TIME),
            read_column=SegmentReader(self.archive, folders, tables, self.channels).read,
            segment_kinds=kinds,
            spring_constant=spring_constant,
            approach_duration=approach_duration,
        )

    def place(self, number: int) -> tuple[float, float] | None:
        """Return x and y [m] of a curve of a map; None where its file does not state them."""
        try:
            table = self._properties(f"index/{number}/{_HEADER}")
            positions = [f"{kind}.header.position." for kind in _MAP_KINDS]
            places = [(float(table[f"{key}x"]), float(table[f"{key}y"])) for key in positions if f"{key}x" in table]
        except (KeyError, ValueError, OSError, zipfile.BadZipFile):
            return None
        return places[0] if places and np.isfinite(places[0]).all() else None

    def _segment_properties(self, folder: str) -> dict[str, str]:
        """Return the properties of a segment, with those that it shares with others in place of their number.

        After ``channel.height.lcd-info.* = 2``, the shared property ``lcd-info.2.x`` is ``channel.height.x`` here.
        """
        table = self._properties(f"{folder}segment-header.properties")
        references = [key for key in table if key.endswith(".*")]
        for reference in references:
            prefix, _, list_name = reference.removesuffix(".*").rpartition(".")
            shared = self._shared_properties.get(f"{list_name}.{table[reference]}", {})
            table |= {f"{prefix}.{name}": text for name, text in shared.items()}
        return table

    @cached_property
    def _shared_properties(self) -> dict[str, dict[str, str]]:
        """The shared properties by name, grouped by the list and the number in it, as in "lcd-info.2"."""
        groups: dict[str, dict[str, str]] = {}
        try:
            table = self._properties(_SHARED_HEADER)
        except KeyError:  # the file of a single curve has none
            return groups
        for key, text in table.items():
            list_name, number, name = (*key.split(".", 2), "", "")[:3]
            groups.setdefault(f"{list_name}.{number}", {})[name] = text
        return groups

    def _properties(self, entry: str) -> dict[str, str]:
        """Return the properties of an entry of the archive: lines ``KEY = TEXT``, comments after ``#`` or ``!``."""
        lines = self.archive.read(entry).decode("utf-8", "replace").splitlines()
        pairs = (line.partition("=") for line in map(str.strip, lines) if line and line[0] not in "#!")
        return {key.strip(): text.strip() for key, _, text in pairs}


def jpk_file(path: Path) -> JpkFile:
    """Return an open file of JPK; raises LogError for a file of another form, and for one that is cut off."""
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError) as error:
        with path.open("rb") as file:
            is_zip = file.read(2) == b"PK"
        reason = "it lacks the form of a zip"
        if is_zip:
            reason = "it is cut off: the list of its curves is missing at its end; copy it again"
        raise LogError(f"{path}: cannot be read as a force curve of JPK: {reason}") from error
    segments, channels = _segments_and_channels(archive.namelist())
    return JpkFile(path, archive, segments, channels)


def _segments_and_channels(entries: Iterable[str]) -> tuple[dict[int, list[str]], dict[str, list[str]]]:
    """Return the folders of the segments by curve, both ascending, and the names of the channels by folder."""
    segments: dict[int, dict[int, str]] = {}
    channels: dict[str, list[str]] = {}
    for entry in entries:
        if match := _SEGMENT_ENTRY.fullmatch(entry):
            curve, segment = int(match[1] or 0), int(match[2])
            segments.setdefault(curve, {})[segment] = entry.rpartition("/")[0] + "/"
        elif entry.endswith(".dat"):
            folder, _, channel = entry.removesuffix(".dat").rpartition("channels/")
            channels.setdefault(folder, []).append(channel)
        elif match := _CURVE_ENTRY.match(entry):  # of a curve that may have no segment
            segments.setdefault(int(match[1]), {})
    folders = {curve: [segments[curve][segment] for segment in sorted(segments[curve])] for curve in sorted(segments)}
    return folders, channels


def segment_kinds(styles: Sequence[str]) -> tuple[float, ...]:
    """Return the kind of each segment by its style, "extend", "retract" or a pause.

    The approach is the last extension before the first retraction; whatever follows that is the retraction.
    """
    retract_index = styles.index("retract") if "retract" in styles else len(styles)
    extensions = [index for index, style in enumerate(styles[:retract_index]) if style == "extend"]
    approach_index = extensions[-1] if extensions else -1
    kinds = []
    for index in range(len(styles)):
        if index == approach_index:
            kinds.append(APPROACH)
        elif index < approach_index:
            kinds.append(BEFORE_APPROACH)
        elif index >= retract_index:
            kinds.append(RETRACT)
        else:
            kinds.append(PAUSE)
    return tuple(kinds)


def _positive_number(table: Properties, key: str) -> float | None:
    """Return the number of a property if it is finite and above 0, else None; raises ValueError for another text."""
    return positive(float(table[key])) if key in table else None


def _reason(error: Exception) -> str:
    """Return the property that is missing, or the error of a damaged one."""
    return f"{error.args[0]} is missing" if isinstance(error, KeyError) else f"{type(error).__name__}: {error}"
