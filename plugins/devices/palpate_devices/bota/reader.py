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
_INVALID = (math.nan,) * 6


class BotaReader(SensorReader):
    """The frames of a SensONE, whose clock counts microseconds."""

    tick: ClassVar[int] = 1000
    counters: ClassVar[tuple[str, ...]] = ("damaged", "skipped_bytes")
    status_bits: ClassVar[Mapping[str, int]] = {"throttled": THROTTLED}

    def open(self) -> Any:
        """Its serial port; opening it resets the sensor."""
        self._decoder, self._stamps = FrameDecoder(), TimestampUnwrapper()
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
        """The frames that have become complete."""
        data = received(line)
        frames = self._decoder.feed(data)
        self.counts["damaged"], self.counts["skipped_bytes"] = self._decoder.damaged, self._decoder.skipped
        if not frames and any(text in data for text in _REBOOT_TEXTS):
            raise DeviceError("the sensor rebooted: its settings and its zero of the start are lost")
        return map(self._reading, frames)

    def _reading(self, frame: Frame) -> Reading:
        stamp = self._stamps.add(frame.stamp)
        if stamp is None:
            raise DeviceError("the sensor rebooted: its clock restarted, and its settings and zero were reset")
        wrench = _INVALID if frame.status & UNUSABLE else frame.wrench  # other processes see the reading, too
        return Reading([*wrench, float(frame.status), frame.temperature], stamp)

    def stop(self, line: Any) -> None:
        """Leave it in CONFIG."""
        stop_stream(line)


def _settle(line: Any, duration: float) -> None:
    """Drop what arrives for a duration [s], and what then waits: it arrived too late for the clock."""
    deadline = clock().now() + duration
    while (rest := deadline - clock().now()) > 0 or clock().wait([line.fileno()], 0.0):
        if clock().wait([line.fileno()], max(rest, 0.0)) and not os.read(line.fileno(), 65536):
            raise DeviceError("the sensor is disconnected")
