"""Twins and the drivers of their devices in one process and in simulated time."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from palpate import DeviceError, HoldUp
from palpate_kit.acquisition.computer import use_host
from palpate_kit.acquisition.simulated_computer import SimulatedComputer
from palpate_kit.protocols.ur_dashboard import DASHBOARD, RTDE, SCRIPT, dashboard_facts
from palpate_kit.simulated_time.simulated_clock import SimulatedClock

from palpate_simulation.twins.controller import Controller
from palpate_simulation.twins.datagram_lines import SocketDatagrams
from palpate_simulation.twins.direct_client import DirectCommands, DirectReadBack, DirectStates
from palpate_simulation.twins.direct_ports import DirectPorts
from palpate_simulation.twins.ports import RobotPorts
from palpate_simulation.twins.sensor_lines import SocketLine
from palpate_simulation.twins.settings import BenchSettings
from palpate_simulation.twins.twin_driver import TwinDriver
from palpate_simulation.twins.world import World


class SimulatedWiring:
    """Calls and pairs of sockets (a Wiring): whatever address a device has, it reaches the twin."""

    def __init__(self) -> None:
        self.robot: DirectPorts | None = None
        self.line: SocketLine | None = None
        self.net: SocketDatagrams | None = None

    def ports(self, address: str, controller: Controller) -> RobotPorts:
        """Return the ports of a controller."""
        self.robot = DirectPorts(controller)
        return self.robot

    def serial(self, path: Path) -> SocketLine:
        """Return the line of a serial sensor."""
        self.line = SocketLine()
        return self.line

    def datagrams(self, address: str) -> SocketDatagrams:
        """Return the line of a sensor on the net."""
        self.net = SocketDatagrams()
        return self.net


class SimulatedHost(SimulatedComputer):
    """A computer whose robots and sensors are twins."""

    def __init__(self, clock: SimulatedClock, wiring: SimulatedWiring) -> None:
        super().__init__(clock)
        self._wiring = wiring

    def end_of(self, role: str) -> Callable[[], None] | None:
        """Return what ends with a process: the inputs that a robot's process has not sent are lost."""
        return self._ports().drop_unsent if role == "robot" else None

    def serial_port(self, path: str, baud: int) -> Any:
        """Return the twin's serial port; raises DeviceError."""
        if self._wiring.line is None:
            raise DeviceError(f"{path} cannot be opened: the twin has no serial sensor")
        return self._wiring.line.opened(path, baud)

    def datagrams(self, address: str, port: int) -> socket.socket:
        """Return a socket to the twin's box; raises OSError."""
        if self._wiring.net is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "the twin has no sensor on the net")
        return self._wiring.net.opened()

    def arm_driver(self, make: Callable[..., Any], settings: Mapping[str, Any], model: Any, tool: Any) -> Any:
        """Return the maker's driver, made by `make`, if the twin speaks the maker's protocol; else the twin's own."""
        ports = self._ports()
        if ports.controller.arm.own_lag is None:
            return make(settings, model, tool)
        return TwinDriver(ports, settings, model, tool)

    def controller_facts(self, address: str, probe: Callable[[str], dict[str, str]]) -> dict[str, str]:
        """Return the facts of the twin's dashboard; raises DeviceError for a port that is shut or silent."""
        ports = self._ports()
        for number, name in ((RTDE, "RTDE"), (DASHBOARD, "dashboard"), (SCRIPT, "script")):
            if number in ports.shut_ports or not ports.is_open:
                raise DeviceError(f"{address}: the {name} port {number} cannot be reached (Connection refused)")
            if ports.mute or (ports.greets_not and number == DASHBOARD):
                raise DeviceError(f"{address}: the {name} port {number} does not answer within 1 s")
        return dashboard_facts(ports.controller.dashboard)

    def robot_states(self, address: str, variables: Sequence[str]) -> DirectStates:
        """Return the states of the twin."""
        return DirectStates(self._ports(), variables)

    def robot_commands(self, address: str) -> DirectCommands:
        """Return the commands of the twin."""
        return DirectCommands(self._ports())

    def read_back(self, address: str, connect: Callable[[str], Any]) -> DirectReadBack:
        """Return the read-back of the twin."""
        return DirectReadBack(self._ports())

    def _ports(self) -> DirectPorts:
        """Return the ports of the world's controller."""
        assert self._wiring.robot is not None  # a world has a controller
        return self._wiring.robot


@contextmanager
def simulated(settings: BenchSettings, seed: int, hold_ups: Sequence[HoldUp] = ()) -> Iterator[World]:
    """Yield twins that the devices of this process reach in simulated time, within the context."""
    clock, wiring = SimulatedClock(hold_ups), SimulatedWiring()
    with clock.running(), use_host(SimulatedHost(clock, wiring)):
        world = World(settings, seed, wiring)
        clock.process_thread(world.run, "twin", "twin").start()
        try:
            yield world
        finally:
            world.close()
            if wiring.net is not None:
                wiring.net.close()
