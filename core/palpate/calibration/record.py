"""A calibration's record: raw readings by role, each at its own time-stamps; nothing is interpolated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import AlignmentSettings, Health, Series, Signal
from palpate.device import Batch, Stream, address
from palpate.errors import LogError

Floats = NDArray[np.float64]

_SECOND = 1_000_000_000  # [ns]
_ROLES = ("force", "position", "velocity")


@dataclass(frozen=True)
class Track:
    """One signal as it was stamped: no declared delay is taken back."""

    time: Floats  # (n,) [s] since the record's first time-stamp
    values: Floats  # (n,) [SI]
    health: Health

    def between(self, begin: float, end: float) -> tuple[Floats, Floats]:
        """Time and values of the readings stamped within [begin, end) [s]."""
        rows = slice(*np.searchsorted(self.time, [begin, end]))
        return self.time[rows], self.values[rows]

    @property
    def rate(self) -> float:
        """Mean rate [Hz] of the readings."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))


@dataclass(frozen=True)
class Record:
    """Force, position and perhaps velocity of one repeat, or of a whole log."""

    force: Track
    position: Track
    velocity: Track | None
    origin: int = 0  # [ns] the first time-stamp

    @property
    def begin(self) -> float:
        """From when on every signal is there [s]."""
        return max(float(self.force.time[0]), float(self.position.time[0]))

    @property
    def end(self) -> float:
        """Until when every signal is there [s]."""
        return min(float(self.force.time[-1]), float(self.position.time[-1]))


class Recorder:
    """Feeds on batches, gives a record."""

    def __init__(self, settings: AlignmentSettings, streams: Mapping[str, tuple[Stream, ...]]) -> None:
        self._health = {(device, s.name): Health(s) for device, group in streams.items() for s in group}
        self._series: dict[str, tuple[tuple[str, str], Series]] = {}
        for role in _ROLES:
            signal = getattr(settings, role)
            if signal is not None:
                self._series[role] = _attached(signal, streams, settings, role)

    def feed(self, device: str, batch: Batch) -> None:
        """Take in the readings of one of a device's streams."""
        key = (device, batch.stream)
        wanted = [series for at, series in self._series.values() if at == key]
        if not wanted:
            return
        health = self._health[key]
        health.invalid += int(np.count_nonzero(~batch.valid))
        rows = health.in_order(batch.time, round(0.02 * _SECOND))
        for series in wanted:
            stamps = batch.time if series.signal.time == "stamp" else batch.received
            series.feed(stamps, batch, rows, health)

    def record(self) -> Record:
        """What was recorded; raises LogError where a signal has no readings."""
        for role, (_, series) in self._series.items():
            if len(series.stamps) < 100:
                raise LogError(
                    f"calibration: {series.signal.channel} ({role}) has {len(series.stamps)} readings; 100 at least"
                )
        origin = min(int(series.stamps[0]) for _, series in self._series.values())
        tracks = {
            role: Track((series.stamps - origin) / _SECOND, series.values, self._health[key])
            for role, (key, series) in self._series.items()
        }
        return Record(tracks["force"], tracks["position"], tracks.get("velocity"), origin)


def _attached(
    signal: Signal, streams: Mapping[str, tuple[Stream, ...]], settings: AlignmentSettings, role: str
) -> tuple[tuple[str, str], Series]:
    as_stamped = signal.model_copy(update={"delay": 0.0})
    for device, group in streams.items():
        for stream in group:
            for column, channel in enumerate(stream.channels):
                if address(device, stream, channel) == signal.channel:
                    limit = settings.force_limit
                    limits = (-limit, limit) if role == "force" and limit is not None else channel.limits
                    watched = role == "force"
                    return (device, stream.name), Series(as_stamped, column, settings.gap, limits, watched)
    raise KeyError(signal.channel)  # the configuration has checked every name
