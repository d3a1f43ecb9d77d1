"""A calibration's record: raw readings by role, each at its own time-stamps; nothing is interpolated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate import Batch, Floats, LogError
from palpate_engine import AlignmentSettings, Health, Hesitations, Intake, Ports, hesitations

_SECOND = 1_000_000_000  # [ns]
_MIN_READINGS = 100  # of a signal: a choice; fewer hold no standstill and no shake
_ROLES = ("force", "position", "velocity")


@dataclass(frozen=True)
class Trace:
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
class CalibrationRecord:
    """Force, position and perhaps velocity of one repeat, or of a whole log."""

    force: Trace
    position: Trace
    velocity: Trace | None
    origin: int = 0  # [ns] the first time-stamp

    @cached_property
    def hesitations(self) -> Hesitations:
        """Hesitations of the arm."""
        return hesitations(self.position.time)

    @property
    def begin(self) -> float:
        """Time [s] from which on every signal has readings."""
        return max(float(self.force.time[0]), float(self.position.time[0]))

    @property
    def end(self) -> float:
        """Time [s] until which every signal has readings."""
        return min(float(self.force.time[-1]), float(self.position.time[-1]))


class CalibrationRecorder:
    """A recorder of batches, whose readings become a record."""

    def __init__(self, settings: AlignmentSettings, ports: Ports) -> None:
        self._ports = ports
        self._intake = Intake(ports, settings.gap, as_stamped=True)

    def feed(self, device: str, batch: Batch) -> None:
        """Take in the readings of one of a device's streams."""
        self._intake.feed(device, batch)

    def record(self) -> CalibrationRecord:
        """Return the record; raises LogError where a signal has too few readings."""
        recorded = {role: series for role, series in self._intake.series.items() if role in _ROLES}
        for role, series in recorded.items():
            if len(series.stamps) < _MIN_READINGS:
                count = f"{len(series.stamps)} readings; {_MIN_READINGS} at least"
                raise LogError(f"calibration: {series.signal.channel} ({role}) has {count}")
        origin = min(int(series.stamps[0]) for series in recorded.values())
        tracks = {
            role: Trace((series.stamps - origin) / _SECOND, series.values, self._intake.health[self._ports[role].key])
            for role, series in recorded.items()
        }
        return CalibrationRecord(tracks["force"], tracks["position"], tracks.get("velocity"), origin)
