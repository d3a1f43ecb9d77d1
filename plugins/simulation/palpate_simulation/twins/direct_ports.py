"""Connections to a software controller within one process: its latest state, its inputs, and their faults."""

from __future__ import annotations

from typing import Any

from palpate import clock

from palpate_simulation.twins.controller import Controller
from palpate_simulation.twins.delay_line import DelayLine


class DirectPorts:
    """Connections of the clients in this process (a RobotPorts): the latest state, and the faults of connections."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.sockets: list[Any] = []
        self.began = clock().now()  # the controller's zero of time, as a monotonic time [s]
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.late: DelayLine[dict[str, Any]] = DelayLine()
        self.missing = 0  # bytes that the states lack at their end
        self.shut_ports: set[int] = set()
        self.is_open = True
        self.connections = 0  # how often all of them ended: a client of an earlier count is cut off
        self._held_until = 0.0  # monotonic time [s]
        self._held_inputs: list[dict[str, Any]] = []
        self.latest: dict[str, Any] | None = None  # state, at the connections that listen
        self.latest_control: dict[str, Any] | None = None  # state, at the connection that commands

    def serve(self, ready: list[Any]) -> None:
        """Do nothing: commands are calls."""

    def broadcast(self) -> None:
        """Take this tick's state, and deliver the inputs that need not be held back any longer."""
        if self._held_inputs and clock().now() >= self._held_until:
            for values in self._held_inputs:
                self._deliver(values)
            self.drop_unsent()
        if self.frozen or self.halved or self.mute:
            return
        self.late.put(dict(self.controller.state()), clock().now())
        for state in self.late.take(clock().now()):
            self.latest = state
        if not self.control_mute and clock().now() >= self._held_until:
            self.latest_control = self.latest

    def say(self, text: str) -> None:
        """Do nothing: the library ignores texts."""

    def shut(self, port: int) -> None:
        """Stop listening on one port."""
        self.shut_ports.add(port)

    def disconnect(self, reset: bool = False) -> None:
        """End every connection."""
        self.connections += 1

    def hold_back(self, duration: float) -> None:
        """Hold back inputs for a time [s]; then all of them are delivered at once."""
        self._held_until = clock().now() + duration

    def drop_unsent(self) -> None:
        """Lose the inputs that are held back, as by a reset of the connection."""
        self._held_inputs = []

    def close(self, reset: bool = False) -> None:
        """Stop listening, and end every connection."""
        self.is_open = False
        self.disconnect()

    def restore(self) -> None:
        """Listen and answer again."""
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.missing = 0
        self.late.clear()
        self.is_open, self._held_until = True, 0.0
        self.drop_unsent()
        self.shut_ports.clear()

    def write(self, values: dict[str, Any]) -> None:
        """Write inputs for the next tick, unless the connection is mute."""
        if self.control_mute or self.mute:
            return
        if clock().now() < self._held_until:
            self._held_inputs.append(values)
        else:
            self._deliver(values)

    def _deliver(self, values: dict[str, Any]) -> None:
        """Give inputs to the controller, dated now."""
        self.controller.write(values)
        self.controller.date(clock().now() - self.began)
