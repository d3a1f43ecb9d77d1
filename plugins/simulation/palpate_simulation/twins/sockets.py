"""The three ports of the software controller, served without ever waiting."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
from typing import Any

from palpate import DeviceError, clock
from palpate_kit.protocols.ur_dashboard import DASHBOARD, RTDE, SCRIPT

from palpate_simulation.twins.controller import GREETING, VERSION, Controller
from palpate_simulation.twins.delay_line import DelayLine
from palpate_simulation.twins.rtde import ClientSession, packet, packets

_NO_LINGER = struct.pack("ii", 1, 0)
_STAMPED = getattr(socket, "SO_TIMESTAMPNS", 35)  # Linux
_STAMP = struct.Struct("qq")


class Client:
    """One connection."""

    def __init__(self, connection: socket.socket, port: int, controller: Controller) -> None:
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, _STAMPED, 1)
        self.socket, self.port = connection, port
        self.received = bytearray()
        self.held: bytearray | None = None  # what the network holds back, where it does
        self.over = False  # the peer has closed its end
        self.unsent = b""
        self.skipped = 0
        self.session = ClientSession(
            VERSION, controller.claim, controller.write, controller.unknown_output, not controller.refuses_start
        )

    def read(self) -> tuple[bytes, float]:
        """What has come, nothing where the peer has gone, and the monotonic time [s] at which the last of it came."""
        data, notes, _, _ = self.socket.recvmsg(65536, socket.CMSG_SPACE(_STAMP.size))
        now = clock().epoch_ns()
        for _, kind, note in notes:
            if kind == _STAMPED:  # by the kernel, who was awake when it came
                seconds, rest = _STAMP.unpack(note[: _STAMP.size])
                return data, clock().now() - max(now - seconds * 10**9 - rest, 0) / 1e9
        return data, clock().now()

    def send(self, data: bytes) -> bool:
        """Send, or keep what did not fit; a peer that does not read is skipped, not queued. False where it has gone."""
        if self.unsent and data:
            self.skipped += 1
            data = b""
        data = self.unsent + data
        try:
            sent = self.socket.send(data) if data else 0
        except BlockingIOError:
            sent = 0
        except OSError:
            return False
        self.unsent = data[sent:]
        return True


class ListeningPorts:
    """RTDE, script and dashboard ports of one address."""

    def __init__(self, host: str, controller: Controller) -> None:
        self._controller = controller
        self._host = host
        self._listening: dict[socket.socket, int] = {}
        self.clients: list[Client] = []
        self.frozen = self.mute = self.halved = self.greets_not = self.control_mute = False
        self.missing = 0
        self.late: DelayLine[dict[str, Any]] = DelayLine()
        self._held_until = 0.0  # monotonic time [s]
        self.began = clock().now()  # the controller's zero of time, as a monotonic time [s]
        self.open()

    def open(self) -> None:
        """Listen, on those ports that are free."""
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
        for listener in [listener for listener, number in self._listening.items() if number == port]:
            listener.close()
            del self._listening[listener]

    def say(self, text: str) -> None:
        """Send a text message to all clients that take data, as the controller does when a user's program asks."""
        data = text.encode()
        message = packet("M", bytes([len(data)]) + data + bytes([4]) + b"twin" + bytes([3]))
        for client in self.clients:
            if client.session.started:
                client.send(message)

    def disconnect(self, reset: bool = False) -> None:
        """End every connection; new ones are welcome."""
        for client in self.clients:
            if reset:
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            self._controller.release(client.session)
            client.socket.close()
        self.clients = []

    def hold_back(self, duration: float) -> None:
        """Hold back what comes on connections that command, for a time [s]; then all of it lands at once.

        As after a reroute: what has not arrived lies in the sender's queue. A sender who resets the connection throws
        his queue away; one who closes it politely, or lives on, delivers it.
        """
        self._held_until = clock().now() + duration
        for client in self.clients:
            if client.session.commands:
                client.held = bytearray()

    def _land(self) -> None:
        """What was held back arrives."""
        for client in [client for client in self.clients if client.held is not None]:
            data, client.held = bytes(client.held or b""), None
            sound = not data or self._take(client, data, clock().now())
            if client.over or not sound:
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
        """What to wait for."""
        deaf = self.control_mute
        heard = (client for client in self.clients if not (client.over or (deaf and client.session.commands)))
        return [*self._listening, *(client.socket for client in heard)]

    def _is_mute(self, client: Client) -> bool:
        """Not spoken to: a connection that commands, where those are mute or held back."""
        return client.held is not None or (self.control_mute and client.session.commands)

    def serve(self, ready: list[socket.socket]) -> None:
        """Take what has come."""
        if clock().now() >= self._held_until:
            self._land()
        for listener, port in self._listening.items():
            if listener in ready:
                with contextlib.suppress(OSError):
                    client = Client(listener.accept()[0], port, self._controller)
                    self.clients.append(client)
                    if port == DASHBOARD and not self.greets_not:
                        client.send(GREETING.encode() + b"\n")
        for client in [client for client in self.clients if client.socket in ready]:
            if not self._read(client):
                self._drop(client)

    def broadcast(self) -> None:
        """Send this tick's state to all clients that want it."""
        now = clock().now()
        self.late.put(dict(self._controller.state()), now)
        states = self.late.take(now)
        wanting = [client for client in self.clients if client.session.started and not self._is_mute(client)]
        if not wanting or self.frozen or not states:
            return
        state = states[-1]
        for client in wanting:
            data = client.session.data(state, self.missing)
            if not client.send(data[: len(data) // 2] if self.halved else data):
                self._drop(client)
        self.frozen = self.frozen or self.halved

    def _drop(self, client: Client) -> None:
        self._controller.release(client.session)
        client.socket.close()
        self.clients.remove(client)

    def _read(self, client: Client) -> bool:
        try:
            data, came = client.read()
        except BlockingIOError:
            return True
        except OSError:
            return False
        if client.held is not None:
            client.held += data
            client.over = not data
            return True
        return self._take(client, data, came)

    def _take(self, client: Client, data: bytes, came: float) -> bool:
        """Answer what has come at a monotonic time [s]; False where the connection is over."""
        client.received += data
        if self.mute or (self.greets_not and client.port == DASHBOARD):
            return bool(data)
        if client.port == RTDE:
            try:
                for kind, payload in packets(client.received):
                    client.send(client.session.answer(kind, payload))
                self._controller.date(came - self.began)
            except (ValueError, struct.error) as error:
                print(f"RTDE: {error}", file=sys.stderr)
                return False
        elif client.port == DASHBOARD:
            *lines, rest = bytes(client.received).split(b"\n")
            client.received[:] = rest
            for line in lines:
                client.send(self._controller.dashboard(line.decode(errors="replace").strip()).encode() + b"\n")
        elif b"\nend\n" in client.received:
            text, _, rest = bytes(client.received).partition(b"\nend\n")
            client.received[:] = rest
            self._controller.upload(text.decode(errors="replace"))
        return bool(data)
