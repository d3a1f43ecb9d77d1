"""Force sensors that speak RDT by UDP as devices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Literal

import numpy as np
from palpate import Batch, Channel, Device, Floats, Force, Frequency, Link, SharedReadings, Stream, Time
from pydantic import Field

from palpate_devices.process.child import Child
from palpate_devices.process.clock import epoch_offset
from palpate_devices.process.readings import SensorReadings
from palpate_devices.process.ring import integers
from palpate_devices.rdt import layout
from palpate_devices.rdt.layout import ROW
from palpate_devices.rdt.packets import PORT

_ONROBOT = 1e4, 1e5  # counts per newton and per newton metre


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
    silence: Time = Field(default=0.1, gt=0, description="a longer silence is a fault")
    boot: Time = Field(default=2.0, gt=0, description="longest wait for the first reading")
    most_lost: int = Field(default=1000, ge=1, description="a larger jump of the readings' numbers is a restart")

    @property
    def live(self) -> bool:
        """It sends as time goes by."""
        return True

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The wrench; status and number of each reading."""
        limits = (-self.force_limit, self.force_limit)
        wrench = [Channel(axis, "N", limits) for axis in "xyz"] + [Channel(f"t{axis}", "N*m") for axis in "xyz"]
        status = (Channel("bits", "1"), Channel("sequence", "1"))
        return (
            Stream("wrench", tuple(wrench), self.rate, "wrench", clock="host", frame="sensor"),
            Stream("status", status, self.rate, clock="host"),
        )

    @property
    def shared_streams(self) -> tuple[str, ...]:
        """The wrench."""
        return ("wrench",)

    def connect(self, seed: int) -> AbstractContextManager[Link]:
        """The sensor, streaming."""
        return self._connected()

    @contextmanager
    def _connected(self) -> Iterator[Link]:
        keys = ("host", "port", "silence", "boot", "most_lost")
        known = (self.counts_per_force, self.counts_per_torque) if self.box == "ati" else _ONROBOT
        settings: dict[str, Any] = {key: getattr(self, key) for key in keys}
        settings |= dict(zip(("counts_per_force", "counts_per_torque"), known, strict=True))
        settings["period"] = 1.0 / self.rate if self.box == "onrobot" else None
        child = Child(f"rdt at {self.host}", layout.MODULE, settings, ROW.size)
        try:
            ready = child.wait_for("ready", self.boot + 5.0)
            yield _RdtLink(child, ready, self.silence)
        finally:
            child.close()


class _RdtLink:
    def __init__(self, child: Child, ready: Mapping[str, Any], silence: float) -> None:
        self._child, self._ready = child, ready
        self._readings = SensorReadings(child, ROW, silence)
        self._counts = {"readings": 0, "unusable": 0}

    def shared(self, stream: str) -> SharedReadings | None:
        """Where the wrench is; see `palpate.Sharing`."""
        return self._readings.shared(stream)

    def batches(self) -> Iterator[Batch]:
        """What has come; raises DeviceError as soon as the sensor fails."""
        self._readings.early()
        for rows in self._readings.rows():
            yield from self._batches(rows)

    def _batches(self, rows: Floats) -> Iterator[Batch]:
        received = integers(rows, ROW.at("host")) + epoch_offset()
        wrench = rows[:, ROW["wrench"]].copy()
        self._counts["readings"] += len(rows)
        self._counts["unusable"] += int(np.count_nonzero(~np.isfinite(wrench).all(axis=1)))
        status, sequence = (integers(rows, ROW.at(name)).astype(float) for name in ("status", "sequence"))
        yield Batch("wrench", received, received, wrench)
        yield Batch("status", received, received, np.column_stack([status, sequence]))

    @property
    def attended(self) -> int:
        """When the sensor's process last looked at its port [ns]."""
        return self._readings.attended

    @property
    def health(self) -> Mapping[str, Any]:
        """What was seen of the sensor and its net."""
        head = self._child.ring.head
        return {
            **self._ready,
            **self._counts,
            "lost": int(head[layout.LOST]),
            "out_of_order": int(head[layout.OUT_OF_ORDER]),
        }
