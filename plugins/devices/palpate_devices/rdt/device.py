"""Force sensors that speak RDT by UDP as devices."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Literal

from palpate import Channel, Device, Force, Frequency, Link, Stream, Time
from palpate_kit.acquisition.sensor_process import SensorProcess, wrench_stream
from palpate_kit.protocols.rdt_packets import PORT
from pydantic import Field

from palpate_devices.rdt.reader import RdtReader

_GRACE = 5.0  # [s], a choice: for the process itself to start, on top of the wait for the first reading


class RdtSensor(Device):
    """ATI's Net F/T box or OnRobot's HEX, by UDP.

    Readings carry a number and no time: they are stamped where they arrive, in a process of its own, and the network's
    delay belongs into the declared uncertainty. Readings that were lost on the way are counted; one with a status other
    than 0 is NaN. The zero is left alone.
    """

    host: str = Field(min_length=1, description="address of the box")
    port: int = Field(default=PORT, ge=1, le=65535, description="its UDP port")
    box: Literal["ati", "onrobot"] = Field(default="ati", description="whose it is")
    counts_per_force: float = Field(default=1e6, gt=0, description="ATI: counts per newton, cfgcpf in netftapi2.xml")
    counts_per_torque: float = Field(default=1e6, gt=0, description="ATI: counts per newton metre, cfgcpt")
    rate: Frequency = Field(default=1000.0, gt=0, le=7000, description="readings per second, as set in an ATI box")
    force_limit: Force = Field(default=200.0, gt=0, description="range of the force; readings beyond it are saturated")
    sensor_timeout: Time = Field(default=0.1, gt=0, description="a longer silence is a fault")
    boot: Time = Field(default=2.0, gt=0, description="longest wait for the first reading")

    @property
    def live(self) -> bool:
        """It sends in real time."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The wrench; status and number of each reading."""
        status = (Channel("bits", "1"), Channel("sequence", "1"))
        return (
            wrench_stream(self.rate, self.force_limit),
            Stream("status", status, self.rate, clock="host"),
        )

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The wrench."""
        return ("wrench",)

    @property
    def twin_settings(self) -> Mapping[str, str]:
        """The sensor of a twin."""
        return {"sensor": f'"{self.box}"'}

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """Return the sensor, streaming."""
        name, settings = f"rdt at {self.host}", self.model_dump()
        return SensorProcess(
            name=name,
            reader=RdtReader,
            streams=self.streams,
            settings=settings,
            silence=self.sensor_timeout,
            start=self.boot + _GRACE,
        ).link()
