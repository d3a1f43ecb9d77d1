"""Reading a SensONE: its frames as readings."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

from palpate import DeviceError, clock
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.sensor_reader import Reading, SensorReader, received
from palpate_kit.protocols.bota_frames import THROTTLED, UNUSABLE, Frame, FrameDecoder, TimestampUnwrapper

from palpate_devices.bota.sensor_setup import configure, latency_timer, powered_since, stop_stream

_REBOOT_TEXTS = (b"App Init", b"FW version")
_INVALID = (math.nan,) * 6  # three forces, three torques
# Choices.
_SHORTEST_BOOT = 0.5  # [s] without frames: a sensor that starts needs seconds, and no reader waits so long for nothing
_LONGEST_BACK = 60.0  # [s] that frames may be late, or a clock be set back by
_CHUNK = 1 << 16  # bytes that are read at once
_MICROSECOND = 1000  # [ns]


class BotaReader(SensorReader):
    """The frames of a SensONE, whose clock counts microseconds."""

    tick: ClassVar[int] = _MICROSECOND
    counters: ClassVar[tuple[str, ...]] = ("damaged", "skipped_bytes")
    status_bits: ClassVar[Mapping[str, int]] = {"throttled": THROTTLED}

    def open(self) -> Any:
        """Return its serial port; opening it resets the sensor."""
        self._decoder, self._stamps = FrameDecoder(), TimestampUnwrapper()
        self._last_arrival = clock().now()  # [s] of a frame
        return host().serial_port(self.settings["port"], self.settings["baud"])

    def start(self, line: Any) -> Mapping[str, Any]:
        """Set it up, and drop what it sends while its filters settle."""
        settings = self.settings
        facts = {"identity": configure(line, settings["baud"], dict(settings), settings["boot"])}
        facts |= {"latency_timer": latency_timer(settings["port"]), "supply": settings["supply"]}
        if settings["supply"] == "usb" and (since := powered_since(settings["port"])) is not None:
            facts["powered_since"] = since
        _settle(line, settings["settle"])
        return facts

    def read(self, line: Any) -> Iterable[Reading]:
        """Return the frames that have become complete."""
        data = received(line)
        frames = self._decoder.feed(data)
        self.counts["damaged"], self.counts["skipped_bytes"] = self._decoder.damaged, self._decoder.skipped
        if not frames and any(text in data for text in _REBOOT_TEXTS):
            raise DeviceError("the sensor rebooted: its settings and its zero of the start are lost")
        return map(self._reading, frames)

    def _reading(self, frame: Frame) -> Reading:
        """Return a frame as a reading; raises DeviceError where the sensor's clock does not go on."""
        stamp, now = self._stamps.add(frame.stamp), clock().now()
        if stamp is None:
            raise DeviceError(clock_problem(self._stamps.backwards(frame.stamp), now - self._last_arrival))
        self._last_arrival = now
        wrench = _INVALID if frame.status & UNUSABLE else frame.wrench  # other processes see the reading, too
        return Reading([*wrench, float(frame.status), frame.temperature], stamp)

    def stop(self, line: Any) -> None:
        """Leave it in CONFIG."""
        stop_stream(line)


def clock_problem(backwards: float, pause: float) -> str:
    """Return why stamps do not follow each other: they go back by a time [s], after a pause [s] without frames."""
    if pause >= _SHORTEST_BOOT:
        return "the sensor rebooted: its clock restarted, and its settings and zero were reset"
    if backwards > _LONGEST_BACK:
        return f"the sensor's time-stamps leap within {1e3 * pause:.0f} ms: its clock is not to be trusted"
    return (
        f"the sensor's time-stamps go back by {1e3 * backwards:.4g} ms while its frames go on: they arrive out of "
        "order, or its clock was set back; in which order it measured is not known"
    )


def _settle(line: Any, duration: float) -> None:
    """Drop what arrives for a duration [s], and what then waits: it arrived too late for the clock."""
    deadline = clock().now() + duration
    while (remaining := deadline - clock().now()) > 0 or clock().wait([line.fileno()], 0.0):
        if clock().wait([line.fileno()], max(remaining, 0.0)) and not os.read(line.fileno(), _CHUNK):
            raise DeviceError("the sensor is disconnected")
