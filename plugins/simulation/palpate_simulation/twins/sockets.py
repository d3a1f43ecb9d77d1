"""The three ports of the software controller, served without ever waiting."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
from typing import Any

from palpate import DeviceError, clock
from palpate_kit.protocols.ur_dashboard import DASHBOARD, RTDE, SCRIPT

from palpate_simulation.twins.controller import GREETING, Controller
from palpate_simulation.twins.delay_line import DelayLine
from palpate_simulation.twins.rtde import packet, packets
from palpate_simulation.twins.socket_client import Client

_NO_LINGER = struct.pack("ii", 1, 0)  # on, for 0 s: closing resets the connection
# Text message of RTDE (M): each text with its length before it, then its level, 3 for information.
_SOURCE, _INFO_LEVEL = b"twin", bytes([3])
_END_OF_PROGRAM = b"\nend\n"


class ListeningPorts:
    """RTDE, script and dashboard ports of one address."""

    def __init__(self, host: str, controller: Controller) -> None:
        self._controller = controller
        self._host = host
        self._listening: dict[socket.socket, int] = {}
        self.clients: list[Client] = []
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.missing = 0  # bytes that the states lack at their end
        self.late: DelayLine[dict[str, Any]] = DelayLine()
        self._held_until = 0.0  # monotonic time [s]
        self.began = clock().now()  # the controller's zero of time, as a monotonic time [s]
        self.open()

    def open(self) -> None:
        """Listen on the ports on which it does not yet; raises DeviceError for one that is in use."""
        for port in {RTDE, SCRIPT, DASHBOARD} - set(self._listening.values()):
            listener = socket.socket()
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind((self._host, port))
            except OSError as error:
                listener.close()
                self.close()
                raise DeviceError(
                    f"{self._host}:{port} cannot be used: {error.strerror}; is a twin running?"
                ) from error
            listener.listen()
            listener.setblocking(False)
            self._listening[listener] = port

    def close(self, reset: bool = False) -> None:
        """Stop listening and end every connection, politely or by a reset."""
        for listener in self._listening:
            listener.close()
        self._listening = {}
        self.disconnect(reset)

    def shut(self, port: int) -> None:
        """Stop listening on one port."""
        for listener, number in list(self._listening.items()):
            if number == port:
                listener.close()
                del self._listening[listener]

    def say(self, text: str) -> None:
        """Send a text message to all clients that take data, as the controller does when a user's program asks."""
        data = text.encode()
        message = packet("M", bytes([len(data)]) + data + bytes([len(_SOURCE)]) + _SOURCE + _INFO_LEVEL)
        for client in self.clients:
            if client.session.started:
                client.send(message)

    def disconnect(self, reset: bool = False) -> None:
        """End every connection, politely or by a reset; new ones are welcome."""
        for client in self.clients:
            if reset:
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            self._controller.release(client.session)
            client.socket.close()
        self.clients = []

    def hold_back(self, duration: float) -> None:
        """Hold back the data of connections that command for a time [s]; then all of it arrives at once.

        As after a reroute: data that have not arrived are in the sender's queue. A sender that resets the connection
        loses its queue; one that closes it politely, or lives on, delivers it.
        """
        self._held_until = clock().now() + duration
        for client in self.clients:
            if client.session.commands:
                client.held = bytearray()

    def _deliver_held(self) -> None:
        """Let the data that were held back arrive."""
        for client in list(self.clients):
            if client.held is None:
                continue
            data, client.held = bytes(client.held), None
            is_open = not data or self._take(client, data, clock().now())
            if client.over or not is_open:
                self._drop(client)

    def restore(self) -> None:
        """Listen and answer again."""
        self._held_until = 0.0
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.missing = 0
        self.late.clear()
        self.open()

    @property
    def sockets(self) -> list[socket.socket]:
        """Sockets to wait for: those that listen, and those of clients whose data are read."""
        sockets = list(self._listening)
        for client in self.clients:
            if not client.over and not (self.control_mute and client.session.commands):
                sockets.append(client.socket)
        return sockets

    def _is_mute(self, client: Client) -> bool:
        """Return True for a connection that commands, where those are mute or held back."""
        return client.held is not None or (self.control_mute and client.session.commands)

    def serve(self, ready: list[socket.socket]) -> None:
        """Accept connections, and read and answer data, of the sockets that are ready."""
        if clock().now() >= self._held_until:
            self._deliver_held()
        for listener, port in self._listening.items():
            if listener in ready:
                with contextlib.suppress(OSError):  # a client that has gone
                    self._accept(listener, port)
        for client in list(self.clients):
            if client.socket in ready and not self._read(client):
                self._drop(client)

    def _accept(self, listener: socket.socket, port: int) -> None:
        """Accept a connection; the dashboard speaks first."""
        client = Client(listener.accept()[0], port, self._controller)
        self.clients.append(client)
        if port == DASHBOARD and not self.greets_not:
            client.send(GREETING.encode() + b"\n")

    def broadcast(self) -> None:
        """Send the newest state that is due to all clients that have requested data."""
        now = clock().now()
        self.late.put(dict(self._controller.state()), now)
        states = self.late.take(now)
        clients = [client for client in self.clients if client.session.started and not self._is_mute(client)]
        if not clients or self.frozen or not states:
            return
        state = states[-1]
        for client in clients:
            data = client.session.data(state, self.missing)
            if not client.send(data[: len(data) // 2] if self.halved else data):
                self._drop(client)
        self.frozen = self.frozen or self.halved

    def _drop(self, client: Client) -> None:
        """Close a connection."""
        self._controller.release(client.session)
        client.socket.close()
        self.clients.remove(client)

    def _read(self, client: Client) -> bool:
        """Read and answer the data of a client, or hold them back; return False where the connection is over."""
        try:
            data, arrival = client.read()
        except BlockingIOError:
            return True
        except OSError:
            return False
        if client.held is not None:
            client.held += data
            client.over = not data
            return True
        return self._take(client, data, arrival)

    def _take(self, client: Client, data: bytes, arrival: float) -> bool:
        """Answer data that arrived at a monotonic time [s]; return False where the connection is over."""
        client.received += data
        if self.mute or (self.greets_not and client.port == DASHBOARD):
            return bool(data)
        if client.port == RTDE:
            try:
                self._take_packets(client, arrival)
            except (ValueError, struct.error) as error:
                print(f"RTDE: {error}", file=sys.stderr)
                return False
        elif client.port == DASHBOARD:
            self._take_lines(client)
        elif _END_OF_PROGRAM in client.received:
            script, _, remainder = bytes(client.received).partition(_END_OF_PROGRAM)
            client.received[:] = remainder
            self._controller.upload(script.decode(errors="replace"))
        return bool(data)

    def _take_packets(self, client: Client, arrival: float) -> None:
        """Answer the whole packets of RTDE, and date their inputs; raises ValueError, struct.error for wrong ones."""
        for letter, payload in packets(client.received):
            client.send(client.session.answer(letter, payload))
        self._controller.date(arrival - self.began)

    def _take_lines(self, client: Client) -> None:
        """Answer the whole lines of the dashboard's client."""
        *lines, remainder = bytes(client.received).split(b"\n")
        client.received[:] = remainder
        for line in lines:
            answer = self._controller.dashboard(line.decode(errors="replace").strip())
            client.send(answer.encode() + b"\n")
