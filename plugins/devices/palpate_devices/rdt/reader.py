"""Reading an RDT box: its packets as readings."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

from palpate import DeviceError, clock
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.sensor_reader import Reading, SensorReader
from palpate_kit.protocols.rdt_packets import PERIOD, REPLY, STOP, STREAM, missing_readings, request

_ONROBOT = 1e4, 1e5  # counts per newton and per newton metre, of OnRobot's boxes
_MILLISECOND = 1e3  # per second; the unit of a box's period
_INVALID = (math.nan,) * 6  # three forces, three torques
_MAX_LOST = 1000  # readings, a choice: one second by default; a larger jump of their numbers is a restart
_BUFFER = 256  # bytes: more than a packet has, so that one of another size is noticed


class RdtReader(SensorReader):
    """The packets of an RDT box, which carry a number and no time."""

    counters: ClassVar[tuple[str, ...]] = ("lost", "out_of_order")

    def open(self) -> socket.socket:
        """Return a socket for datagrams."""
        settings = self.settings
        self._sequence: int | None = None  # of the latest reading
        ati = settings["counts_per_force"], settings["counts_per_torque"]
        force, torque = _ONROBOT if settings["box"] == "onrobot" else ati
        self._scale = (*(force,) * 3, *(torque,) * 3)
        return host().datagrams(settings["host"], settings["port"])

    def start(self, line: socket.socket) -> Mapping[str, Any]:
        """Ask for readings, and wait for the first."""
        if self.settings["box"] == "onrobot":
            line.send(request(PERIOD, round(_MILLISECOND / self.settings["rate"])))
        line.send(request(STREAM))
        boot = self.settings["boot"]
        if not clock().wait([line], boot):
            raise DeviceError(f"the sensor is silent: no reading within {boot:g} s")
        line.recv(1, socket.MSG_PEEK)  # raises where nothing listens at that port
        return {}

    def read(self, line: socket.socket) -> Iterable[Reading]:
        """Return the reading of one packet, unless an older one overtook it."""
        data = line.recv(_BUFFER)
        if len(data) != REPLY.size:
            return ()
        # Number of the reading, its status, and counts of three forces and three torques; a status of 0 is sound.
        sequence, _, status, *counts = REPLY.unpack(data)
        # The numbers show readings that were lost, or overtaken.
        lost = missing_readings(self._sequence, sequence)
        if lost < 0:
            self.counts["out_of_order"] += 1
            return ()
        if lost > _MAX_LOST:
            raise DeviceError(f"the sensor's numbers jump by {lost}: it was restarted, and its zero reset")
        self.counts["lost"] += lost
        self._sequence = sequence
        wrench = _INVALID if status else [count / scale for count, scale in zip(counts, self._scale, strict=True)]
        return (Reading((*wrench, status, sequence)),)

    def stop(self, line: socket.socket) -> None:
        """Ask for no more."""
        line.send(request(STOP))
