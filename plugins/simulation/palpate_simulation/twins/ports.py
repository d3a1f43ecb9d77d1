"""Ports and lines by which the twins are reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from palpate_kit.protocols.rdt_packets import PORT

from palpate_simulation.twins.controller import Controller
from palpate_simulation.twins.datagram_lines import DatagramLine, UdpLine
from palpate_simulation.twins.delay_line import DelayLine
from palpate_simulation.twins.sensor_lines import PseudoTerminal, SerialLine
from palpate_simulation.twins.sockets import ListeningPorts


class RobotPorts(Protocol):
    """Ports of a controller, with the faults that they can have."""

    began: float  # the controller's zero of time, as a monotonic time [s]
    frozen: bool  # no states are sent
    mute: bool  # nothing is answered
    halved: bool  # half a state is sent, then none
    missing: int  # bytes that the states lack at their end
    greets_not: bool  # the dashboard does not speak first
    late: DelayLine[dict[str, Any]]  # of the states
    control_mute: bool  # the connection that commands is neither read nor answered

    @property
    def sockets(self) -> list[Any]:
        """Sockets to wait for."""
        ...

    def serve(self, ready: list[Any]) -> None:
        """Take connections and data of the sockets that are ready."""

    def broadcast(self) -> None:
        """Send this tick's state."""

    def say(self, text: str) -> None:
        """Send a text between two states."""

    def shut(self, port: int) -> None:
        """Stop listening on one port."""

    def disconnect(self, reset: bool = False) -> None:
        """End every connection, politely or by a reset; new ones are welcome."""

    def hold_back(self, duration: float) -> None:
        """Hold commands back for a time [s]; then all of them arrive at once."""

    def close(self, reset: bool = False) -> None:
        """Stop listening, and end every connection."""

    def restore(self) -> None:
        """Listen and answer again."""


class Wiring(Protocol):
    """Connections between twins and the drivers that talk to them."""

    def ports(self, address: str, controller: Controller) -> RobotPorts:
        """Return the ports of a controller."""
        ...

    def serial(self, path: Path) -> SerialLine:
        """Return the line of a serial sensor."""
        ...

    def datagrams(self, address: str) -> DatagramLine:
        """Return the line of a sensor on the net."""
        ...


class NetworkWiring:
    """Ports of a loopback address, a pseudo-terminal, UDP: the real drivers reach them unchanged."""

    def ports(self, address: str, controller: Controller) -> RobotPorts:
        """Return the ports of RTDE, script and dashboard."""
        return ListeningPorts(address, controller)

    def serial(self, path: Path) -> SerialLine:
        """Return a pseudo-terminal behind a symbolic link."""
        return PseudoTerminal(path)

    def datagrams(self, address: str) -> DatagramLine:
        """Return the port for RDT."""
        return UdpLine(address, PORT)
