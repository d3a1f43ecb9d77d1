"""The SensONE as a device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Literal

import numpy as np
from palpate import Batch, Channel, Device, Floats, Force, Link, SharedReadings, Stream, Time
from pydantic import Field, field_validator

from palpate_devices.bota import layout
from palpate_devices.bota.commands import BAUD_RATES
from palpate_devices.bota.frames import THROTTLED, UNUSABLE
from palpate_devices.bota.layout import ROW
from palpate_devices.process.child import Child
from palpate_devices.process.clock import ClockMap, epoch_offset
from palpate_devices.process.readings import SensorReadings
from palpate_devices.process.ring import integers


class BotaSensor(Device):
    """A Bota SensONE with its serial interface (RS-422 or USB, 460800 baud), by pyserial.

    The sensor's clock is mapped to the host's by the lower envelope of the arrival times. A reading whose status says
    over range, invalid or raw is NaN; frames with a wrong CRC are dropped and counted. Rates come from the sensor's
    time-stamps: nominally 51200 Hz over the sinc length, in fact less by what the line takes. The sensor is set up at
    every start and nothing is ever written to its EEPROM. Opening the port resets it, which takes some seconds.
    """

    port: str = Field(min_length=1, description="its serial port, such as /dev/serial/by-id/...")
    baud: int = Field(default=460800, description="its baud rate: 9600, 57600, 115200, 230400 or 460800")
    sinc: int = Field(default=64, ge=32, le=2048, description="length of the sinc filter: 64 is 800 Hz, 512 is 100 Hz")
    fir: bool = Field(default=False, description="low-pass filter after the sinc filter; adds delay")
    fast: bool = Field(default=False, description="faster step response of that low-pass filter")
    temperature_compensation: bool = Field(default=False, description="the sensor's own compensation")
    force_limit: Force = Field(default=500.0, gt=0, description="range of the force; readings beyond it are saturated")
    supply: Literal["usb", "robot", "unknown"] = Field(
        default="unknown",
        description="its power supply, the USB adapter or the robot: shows since when it has been powered",
    )
    silence: Time = Field(default=0.1, gt=0, description="a longer silence is a fault")
    boot: Time = Field(default=3.0, gt=0, description="longest time to start after its port was opened")
    settle: Time = Field(default=0.5, ge=0, description="settling time of its filters after the start")

    @field_validator("baud")
    @classmethod
    def _known_baud(cls, value: int) -> int:
        if value not in BAUD_RATES:
            raise ValueError(f"{value} is none of {', '.join(map(str, BAUD_RATES))}")
        return value

    @property
    def live(self) -> bool:
        """It sends as time goes by."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The wrench; status bits and temperature."""
        limits = (-self.force_limit, self.force_limit)
        wrench = [Channel(axis, "N", limits) for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        rate = 51200.0 / self.sinc
        status = (Channel("bits", "1"), Channel("temperature", "degC"))
        return (
            Stream("wrench", tuple(wrench), rate, "wrench", clock="host", frame="sensor", delay=self.filter_delay),
            Stream("status", status, rate, clock="host"),
        )

    @property
    def filter_delay(self) -> float:
        """What its filters hold a reading back by [s], nominally: a sinc filter of third order, and the low-pass one.

        The maker gives no delay; these follow from the length of the one and the cut-off frequency of the other.
        """
        sinc = 1.5 * self.sinc / 51200.0
        return sinc + (0.5 / (189.0 * 64.0 / self.sinc) if self.fir else 0.0)

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The wrench."""
        return ("wrench",)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The sensor, set up and streaming."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        keys = (
            "port",
            "baud",
            "sinc",
            "fir",
            "fast",
            "temperature_compensation",
            "silence",
            "boot",
            "settle",
            "supply",
        )
        settings = {key: getattr(self, key) for key in keys}
        child = Child(f"bota at {self.port}", layout.MODULE, settings, ROW.size)
        try:
            ready = child.wait_for("ready", self.boot + self.settle + 15.0)
            yield _BotaLink(child, ready, self.silence)
        finally:
            child.close()


class _BotaLink:
    def __init__(self, child: Child, ready: Mapping[str, Any], silence: float) -> None:
        self._child, self._ready = child, ready
        self._readings = SensorReadings(child, ROW, silence)
        self._clock = ClockMap()
        self._counts = {"readings": 0, "throttled": 0, "unusable": 0}

    def shared(self, stream: str) -> SharedReadings | None:
        """Where the wrench is; see `palpate.Sharing`."""
        return self._readings.shared(stream)

    def batches(self) -> Iterator[Batch]:
        """What has come, every 4 ms; raises DeviceError as soon as the sensor fails."""
        early = self._readings.early()
        host = integers(early, ROW.at("host")) + epoch_offset()
        self._clock.to_host(integers(early, ROW.at("sensor")) * 1000, host)
        for rows in self._readings.rows():
            yield from self._batches(rows)

    def _batches(self, rows: Floats) -> Iterator[Batch]:
        received = integers(rows, ROW.at("host")) + epoch_offset()
        stamps = self._clock.to_host(integers(rows, ROW.at("sensor")) * 1000, received)
        status = integers(rows, ROW.at("status"))
        wrench = rows[:, ROW["wrench"]].copy()
        unusable = (status & UNUSABLE) != 0
        wrench[unusable] = np.nan
        self._counts["readings"] += len(rows)
        self._counts["throttled"] += int(np.count_nonzero(status & THROTTLED))
        self._counts["unusable"] += int(np.count_nonzero(unusable))
        yield Batch("wrench", stamps, received, wrench)
        yield Batch("status", stamps, received, np.column_stack([status.astype(float), rows[:, ROW["temperature"]]]))

    @property
    def attended(self) -> int:
        """When the sensor's process last looked at its port [ns]."""
        return self._readings.attended

    @property
    def health(self) -> Mapping[str, Any]:
        """What was seen of the sensor and its line."""
        head = self._child.ring.head
        return {
            **self._ready,
            **self._counts,
            "damaged": int(head[layout.DAMAGED]),
            "skipped_bytes": int(head[layout.SKIPPED]),
            "clock_wander": self._clock.wander,
            "clock_deviation": self._clock.deviation,
        }
