"""The columns of a JPK curve: whole numbers of its channels, scaled by the properties of its segments."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_logs.force_curve import FORCE, MEASURED, PIEZO, SEGMENT, TIME

SEGMENT_HEADER = "force-segment-header."
CHANNELS = {  # by column: names that its channel may have, the calibration whose numbers count, their unit
    FORCE: (("vDeflection",), "force", "N"),
    MEASURED: (("strainGaugeHeight", "capacitiveSensorHeight", "measuredHeight"), "nominal", "m"),
    PIEZO: (("height", "head-height"), "calibrated", "m"),
}
_ENCODERS = {  # by the stated type of numbers: that of numpy, the highest byte first
    "signedshort": ">i2", "unsignedshort": ">u2", "signedinteger": ">i4", "unsignedinteger": ">u4", "signedlong": ">i8",
}  # fmt: skip
_MAX_CALIBRATIONS = 8  # of a channel, each based on the next; a choice over the usual two, against a circle
Properties = Mapping[str, str]


@dataclass(frozen=True)
class SegmentReader:
    """The columns of one curve, segment by segment."""

    archive: zipfile.ZipFile
    folders: Sequence[str]  # of the segments
    tables: Sequence[Properties]  # of the segments
    channels: Mapping[str, Sequence[str]]  # names of the channels in each folder

    def read(self, column: str) -> Floats:
        """Return a column (n,) over all segments: the number of the segment, time [s], or a channel [SI].

        Raises KeyError, ValueError for properties that are missing or damaged.
        """
        counts = [int(float(table[f"{SEGMENT_HEADER}num-points"])) for table in self.tables]
        if column == SEGMENT:
            return np.repeat(np.arange(len(counts), dtype=float), counts)
        if column == TIME:
            return self._time(counts)
        parts = [self._channel(column, segment) for segment in range(len(self.folders))]
        if [len(part) for part in parts] != counts:
            raise ValueError(f"{sum(map(len, parts))} readings are there, and {sum(counts)} are stated")
        return np.concatenate(parts)

    def _time(self, counts: Sequence[int]) -> Floats:
        """Return the time (n,) [s] of segments with counts of readings, which divide a segment's duration evenly."""
        durations = [float(table[f"{SEGMENT_HEADER}duration"]) for table in self.tables]
        starts = np.concatenate([[0.0], np.cumsum(durations)])
        parts = [
            np.linspace(start, start + duration, count, endpoint=False)
            for start, duration, count in zip(starts, durations, counts, strict=False)
        ]
        return np.concatenate(parts)

    def _channel(self, column: str, segment: int) -> Floats:
        """Return the readings (n,) [SI] of a column in one segment.

        The whole numbers of the channel take the scale of the encoder, then that of each calibration, from the one that
        is based on the encoder to the one whose numbers count.
        """
        channel_names, slot, expected_unit = CHANNELS[column]
        folder, table = self.folders[segment], self.tables[segment]
        name = next((channel for channel in self.channels.get(folder, ()) if channel in channel_names), None)
        if name is None:
            raise ValueError(f"no channel {' or '.join(channel_names)} in segment {segment}")
        prefix = f"channel.{name}."
        encoder = f"{prefix}data.encoder." if f"{prefix}data.encoder.type" in table else f"{prefix}encoder."
        number_type = table[f"{encoder}type"]
        if number_type not in _ENCODERS:
            raise ValueError(f"numbers of type {number_type} are not read")
        # From whole numbers to readings; files name the keys of the encoder in either way.
        numbers = np.frombuffer(self.archive.read(f"{folder}channels/{name}.dat"), np.dtype(_ENCODERS[number_type]))
        readings = _apply_scale(numbers.astype(float), table, f"{encoder}scaling.")
        calibrations = _calibrations(table, name, slot)
        for calibration in calibrations:
            readings = _apply_scale(readings, table, f"{calibration}scaling.")
        last_scale = f"{calibrations[-1] if calibrations else encoder}scaling."
        _demand_unit(table, last_scale, expected_unit)
        return readings


def _calibrations(table: Properties, channel: str, slot: str) -> list[str]:
    """Return the prefixes of the keys of a channel's calibrations, in the order in which they are applied.

    The last one is that in `slot`. Each states the slot that it is based on, down to the base, which is the encoder's.
    Raises ValueError for a slot without a calibration.
    """
    conversion_set = f"channel.{channel}.conversion-set."
    base = table[f"{conversion_set}conversions.base"]
    prefixes: list[str] = []
    while slot != base and len(prefixes) < _MAX_CALIBRATIONS:
        prefix = f"{conversion_set}conversion.{slot}."
        if f"{prefix}base-calibration-slot" not in table:
            raise ValueError(f"{channel} is not calibrated: the file states no {slot}")
        prefixes.append(prefix)
        slot = table[f"{prefix}base-calibration-slot"]
    return prefixes[::-1]


def _demand_unit(table: Properties, scale: str, expected_unit: str) -> None:
    """Raise ValueError for a scale in another unit, by the properties below its prefix: "unit.unit" or "unit"."""
    unit = table.get(f"{scale}unit.unit") or table.get(f"{scale}unit") or "no unit"
    if unit != expected_unit:
        raise ValueError(f"is in {unit}, expected {expected_unit}")


def _apply_scale(numbers: Floats, table: Properties, scale: str) -> Floats:
    """Return multiplier * numbers + offset, by the properties below the prefix of a scale."""
    return np.asarray(float(table[f"{scale}multiplier"]) * numbers + float(table[f"{scale}offset"]))
