"""The guard: stops the arms when a reading, or its absence, says so."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import AlignmentSettings, Signal
from palpate.device import Arm, Batch, Retractable, Stream, address
from palpate.errors import DeviceError
from palpate.pipeline.rest import Rest, refuse_unrest
from palpate.safety import SafetySettings

_LOOK_EVERY = 0.02  # [s]
_ENOUGH = 10  # readings


class _Column:
    """One signal on its way past the guard."""

    def __init__(self, signal: Signal, streams: Mapping[str, tuple[Stream, ...]]) -> None:
        self.device, self.stream, self.index, self.limits = _found(signal, streams)
        self.name = signal.channel
        self.rest: list[NDArray[np.float64]] = []
        self.heard = time.monotonic()

    def at_rest(self) -> NDArray[np.float64]:
        values = np.concatenate(self.rest) if self.rest else np.zeros(0)
        return values[np.isfinite(values)]


def _found(
    signal: Signal, streams: Mapping[str, tuple[Stream, ...]]
) -> tuple[str, str, int, tuple[float, float] | None]:
    for device, group in streams.items():
        for stream in group:
            for index, channel in enumerate(stream.channels):
                if address(device, stream, channel) == signal.channel:
                    return device, stream.name, index, channel.limits
    raise KeyError(signal.channel)  # the configuration has checked every name


class Guard:
    """Sees every batch before anybody else does, in the thread that received it.

    It trips on a force beyond `stop_force` along any axis of the sensor, a tip below the depth limit, a reading that is
    over range or invalid, a sensor or robot that is silent, a device that fails, and on being asked. Tripping makes the
    arms retract where they can, else stop; the first reason counts.
    """

    def __init__(
        self, limits: SafetySettings | None, alignment: AlignmentSettings, streams: Mapping[str, tuple[Stream, ...]]
    ) -> None:
        self._limits = limits
        self._force = _Column(alignment.force, streams)
        self._position = _Column(alignment.position, streams)
        self._velocity = _Column(alignment.velocity, streams) if alignment.velocity else None
        self._tare: NDArray[np.float64] | None = None
        self._resting: list[NDArray[np.float64]] = []  # all channels of the force's stream
        self._arms: list[Arm] = []
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self.reason: str | None = None
        self.tripped: float | None = None  # monotonic [s]
        self.peak = 0.0  # [N] largest tared reading along the normal
        self._watch = threading.Thread(target=self._look, daemon=True, name="guard")

    def begin(self, arms: list[Arm]) -> None:
        """From now on the arms are to be stopped, and silence is a fault."""
        self._arms = arms
        now = time.monotonic()
        self._force.heard = self._position.heard = now
        if self.reason is not None:
            self._stop_arms()
        self._watch.start()

    def close(self) -> None:
        """The motion is over."""
        self._closed.set()
        if self._watch.ident is not None:
            self._watch.join()

    def trip(self, reason: str) -> None:
        """Stop the arms: from any thread; the first reason is kept."""
        with self._lock:
            if self.reason is not None:
                return
            self.reason, self.tripped = reason, time.monotonic()
        self._stop_arms()

    def _stop_arms(self) -> None:
        for arm in self._arms:
            if isinstance(arm, Retractable):
                arm.retract()
            else:
                arm.stop()

    def check(self, device: str, batch: Batch) -> None:
        """Look at a batch."""
        if not len(batch.time):
            return
        now = time.monotonic()
        for column in (self._force, self._position, self._velocity):
            if column is not None and (column.device, column.stream) == (device, batch.stream):
                column.heard = now
                if self._tare is None:
                    column.rest.append(batch.values[:, column.index])
        if self._limits is not None:
            if (self._force.device, self._force.stream) == (device, batch.stream):
                self._check_force(batch, self._limits)
            if (self._position.device, self._position.stream) == (device, batch.stream):
                lowest = float(np.nanmin(batch.values[:, self._position.index]))
                if self._tare is not None and lowest < self._limits.low[2]:
                    self.trip(
                        f"the tip is at {1e3 * lowest:.2f} mm, below the limit of {1e3 * self._limits.low[2]:g} mm"
                    )

    def _check_force(self, batch: Batch, limits: SafetySettings) -> None:
        values = batch.values[:, :3] if batch.values.shape[1] >= 3 else batch.values[:, [self._force.index]]
        if self._tare is None:
            self._resting.append(values)
            return
        if not np.isfinite(batch.values[:, self._force.index]).all():
            self.trip(f"a reading of {self._force.name} is over range or invalid")
            return
        if (
            self._force.limits
            and not self._force.limits[0] < batch.values[-1, self._force.index] < self._force.limits[1]
        ):
            self.trip(f"{self._force.name} is at the end of its range")
        felt = np.abs(values - self._tare)
        largest = float(np.nanmax(felt))
        self.peak = max(self.peak, largest)
        if largest > limits.stop_force:
            self.trip(f"the force is {largest:.1f} N, over the limit of {limits.stop_force:g} N that stops the motion")

    @property
    def rested(self) -> bool:
        """Whether force and position have sent enough to be judged."""
        return min(len(self._force.at_rest()), len(self._position.at_rest())) >= _ENOUGH

    def judge_rest(self, declared: Mapping[str, tuple[float, float]] | None = None) -> Rest:
        """Tare and noise from the rest in free air; raises DeviceError with advice where they are not plausible.

        `declared`: the noise of force [N] and velocity [m/s] that estimators count on, by their names.
        """
        force, position = self._force.at_rest(), self._position.at_rest()
        velocity = self._velocity.at_rest() if self._velocity else np.zeros(0)
        if len(force) < _ENOUGH or len(position) < _ENOUGH:
            silent = self._force.name if len(force) < _ENOUGH else self._position.name
            raise DeviceError(f"{silent} gave nothing usable at rest; is the device on, and are its readings valid?")
        speed = float(velocity.std(ddof=1)) if len(velocity) > _ENOUGH else None
        found = Rest(float(force.mean()), float(force.std(ddof=1)), speed)
        if self._limits is not None and self._resting:
            refuse_unrest(found, self._limits, self._force.name, declared or {})
            self._tare = np.nanmean(np.concatenate(self._resting), axis=0)
        self._resting = []
        return found

    def _look(self) -> None:
        """Silence makes no batch: somebody has to look."""
        while not self._closed.wait(_LOOK_EVERY):
            if self._limits is None or self.reason is not None:
                continue
            now = time.monotonic()
            for column in (self._force, self._position):
                if now - column.heard > self._limits.stale:
                    self.trip(f"{column.name} is silent for {1e3 * (now - column.heard):.0f} ms")
