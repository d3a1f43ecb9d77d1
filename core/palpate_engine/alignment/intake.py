"""Intake: readings on their way in, each stream with its health, each signal with its series."""

from __future__ import annotations

import numpy as np
from palpate.device import Batch, Stream
from palpate.stream_health import Health

from palpate_engine.alignment.ports import Ports
from palpate_engine.alignment.signal_series import Series

_SECOND = 1_000_000_000  # [ns]
_GAP_INTERVALS = 5.0  # usual intervals without a reading, which make a gap of a slow stream: a choice


class Intake:
    """Takes in batches; aligner and calibration read the same signals from it, with the same gaps."""

    def __init__(self, ports: Ports, gap: float, as_stamped: bool = False) -> None:
        """Take the ports, the longest gap [s] between readings, and True for times without the declared delays."""
        self._gap = gap
        self.health = {(d, s.name): Health(s) for d, group in ports.streams.items() for s in group}
        self.series: dict[str, Series] = {}  # by role
        self._fed: dict[tuple[str, str], list[Series]] = {key: [] for key in self.health}
        for role, port in ports.roles.items():
            signal = port.signal.model_copy(update={"delay": 0.0}) if as_stamped else port.signal
            series = Series(signal, port.column, self._pause(port.stream), port.limits, watched=role == "force")
            self.series[role] = series
            self._fed[port.key].append(series)

    def _pause(self, stream: Stream) -> float:
        """Return how long [s] readings of a stream may fail to come before that is a gap."""
        return max(self._gap, _GAP_INTERVALS / stream.rate if stream.rate else 0.0)

    def feed(self, device: str, batch: Batch) -> None:
        """Take in the readings of one of a device's streams."""
        health = self.health[device, batch.stream]
        health.invalid += int(np.count_nonzero(~batch.valid))
        health.arrived(batch.time, batch.received)
        rows = health.in_order(batch.time, round(self._pause(health.stream) * _SECOND))
        for series in self._fed[device, batch.stream]:
            stamps = batch.time if series.signal.time == "stamp" else batch.received
            series.feed(stamps, batch, rows, health)
