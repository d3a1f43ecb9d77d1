"""The gauge on its serial line."""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any

from palpate import Device, Link, Stream, Time
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.sensor_process import SensorProcess
from palpate_kit.acquisition.sensor_reader import Reading, SensorReader, received
from pydantic import Field

from palpate_gauge.lines import CHANNELS, parse_line


class GaugeReader(SensorReader):
    """Lines of text, with the gauge's own clock."""

    tick = 1000  # [ns] of one count of its clock
    counters = ("damaged",)

    def open(self) -> Any:
        """Open the line."""
        self.rest = b""
        return host().serial_port(self.settings["port"], 115200)

    def start(self, line: Any) -> Mapping[str, Any]:
        """Nothing is to be set up; a line that was begun before is dropped."""
        return {"maker": "gauge"}

    def read(self, line: Any) -> Iterator[Reading]:
        """Yield the readings of whole lines."""
        *lines, self.rest = (self.rest + received(line)).split(b"\n")
        for text in lines:
            try:
                stamp, force, height = parse_line(text)
            except ValueError:
                self.counts["damaged"] += 1
                continue
            yield Reading((force, height), stamp)


class Gauge(Device):
    """A force gauge with an encoder, 500 readings a second on a serial port."""

    port: str = Field(description="such as /dev/ttyUSB0")
    sensor_timeout: Time = Field(default=0.1, gt=0, description="silence that ends a run")

    @property
    def live(self) -> bool:
        """It sends in real time."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream."""
        return (Stream("", CHANNELS, 500.0, clock="gauge"),)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Read it in a process of its own."""
        name, settings = f"gauge at {self.port}", self.model_dump()
        return SensorProcess(name, GaugeReader, self.streams, settings, self.sensor_timeout, start=5.0).link()
