"""The SensONE as a device."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Annotated, Literal

from palpate import Channel, Device, Force, Link, Stream, Time
from palpate_kit.acquisition.sensor_process import SensorProcess, wrench_stream
from pydantic import AfterValidator, Field, field_validator

from palpate_devices.bota.reader import BotaReader
from palpate_devices.bota.sensor_setup import BAUD_RATES

_SINC_RATE = 51200.0  # [Hz], the maker's: readings per second times the sinc length
_SINC_DELAY = 1.5  # sinc lengths: a filter of third order averages three times, each by half a length
_CUTOFF, _CUTOFF_SINC = 189.0, 64.0  # [Hz] at a sinc length, the maker's: falls as the sinc length grows
_LOW_PASS_DELAY = 0.5  # periods of the cut-off, an estimate: the maker gives no delay
_GRACE = 15.0  # [s], a choice: for the set-up, whose four commands may take twice 2 s each


class BotaSensor(Device):
    """A Bota SensONE with its serial interface (RS-422 or USB, 460800 baud), by pyserial.

    The sensor's clock is mapped to the host's by the lower envelope of the arrival times. A reading whose status says
    over range, invalid or raw is NaN; frames with a wrong CRC are dropped and counted. Rates come from the sensor's
    time-stamps: nominally 51200 Hz over the sinc length, in fact less by what the line takes. The sensor is set up at
    every start and nothing is ever written to its EEPROM. Opening the port resets it, which takes some seconds.
    """

    port: Annotated[str, AfterValidator(os.path.expanduser)] = Field(
        min_length=1, description="its serial port, such as /dev/serial/by-id/..."
    )
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
    sensor_timeout: Time = Field(default=0.1, gt=0, description="a longer silence is a fault")
    boot: Time = Field(default=3.0, gt=0, description="longest time to start after its port was opened")
    settle: Time = Field(default=0.5, ge=0, description="settling time of its filters after the start")

    @field_validator("baud")
    @classmethod
    def _known_baud(cls, value: int) -> int:
        if value not in BAUD_RATES:
            raise ValueError(f"{value} is not one of {', '.join(map(str, BAUD_RATES))}")
        return value

    @property
    def live(self) -> bool:
        """It sends in real time."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The wrench; status bits and temperature."""
        rate = _SINC_RATE / self.sinc
        status = (Channel("bits", "1"), Channel("temperature", "degC"))
        return (
            wrench_stream(rate, self.force_limit, self.filter_delay),
            Stream("status", status, rate, clock="host"),
        )

    @property
    def filter_delay(self) -> float:
        """The nominal delay of a reading by its filters [s]: a sinc filter of third order, and the low-pass one.

        The maker gives no delay; these follow from the length of the one and the cut-off frequency of the other.
        """
        sinc_delay = _SINC_DELAY * self.sinc / _SINC_RATE
        return sinc_delay + (_LOW_PASS_DELAY / (_CUTOFF * _CUTOFF_SINC / self.sinc) if self.fir else 0.0)

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The wrench."""
        return ("wrench",)

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The sensor of a twin."""
        return {"sensor": '"bota"'}

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return the sensor, set up and streaming."""
        start = self.boot + self.settle + _GRACE
        name = f"bota at {self.port}"
        return SensorProcess(
            name=name,
            reader=BotaReader,
            streams=self.streams,
            settings=self.model_dump(),
            silence=self.sensor_timeout,
            start=start,
        ).link()
