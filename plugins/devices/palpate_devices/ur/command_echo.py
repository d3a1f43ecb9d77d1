"""Whether commands arrive: each has a number, which the controller reads back."""

from __future__ import annotations

import math
import socket
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from palpate import Floats
from palpate_kit.protocols.ur_dashboard import RTDE

# `servoL` sends an acceleration that neither the control program nor `servoj` uses: the command's number goes there.
_REGISTER = "input_double_register_7"
_NUMBERS = 1 << 15
_UNIT = 1e-3  # [m/s^2] of one; the client library takes up to 40 m/s^2, the limit of a joint [rad/s^2]
_TIMEOUT = 1.0  # [s]
_ON_THEIR_WAY = 64  # commands; of a lost link more are
_NOW = 0.5e-3  # [s] within which two instants are one: a quarter of a tick
_ENOUGH = 16  # commands that came back, a choice: a computer that was held up makes one of them late, not all
_RECIPE = struct.Struct(">Bdd")  # its number, time [s], register
STATE_BYTES = _RECIPE.size


@dataclass(frozen=True)
class _SentCommand:
    number: int
    sent: float  # [s] of the controller's time, by its latest state
    place: Floats  # (3,) [m]


class Echo:
    """Numbers of commands as they go out and as they come back, by the controller's own time [s].

    That time, because a host that was held up has neither sent nor heard anything meanwhile.
    """

    def __init__(self) -> None:
        self._sent = 0
        self._heard: int | None = None
        self._since = 0.0  # the latest news, or the first command after which there was none to come
        self._commands: deque[_SentCommand] = deque(maxlen=_ON_THEIR_WAY)  # from the latest that came back on
        self._usual = math.inf  # [s] the shortest time in which one came back
        self._answers = 0  # commands that came back

    def number(self, now: float, place: Floats) -> float:
        """Return the number of the next command, to a place (3,) [m], as an acceleration [m/s^2], sent at a time
        [s]."""
        if self._heard == self._sent % _NUMBERS or not self._sent:
            self._since = now
        self._sent += 1
        self._commands.append(_SentCommand(self._sent % _NUMBERS, now, place.copy()))
        return self._sent % _NUMBERS * _UNIT

    def hear(self, now: float, acceleration: float) -> None:
        """What the controller read back at a time [s]."""
        heard = round(acceleration / _UNIT)
        if heard == self._heard:
            return
        self._heard, self._since = heard, now
        if any(command.number == heard for command in self._commands):
            while self._commands[0].number != heard:
                self._commands.popleft()
            self._usual = min(self._usual, now - self._commands[0].sent)
            self._answers += 1

    @property
    def answer_time(self) -> float:
        """The shortest time [s] in which a command came back; 0 before enough of them did."""
        return self._usual if self._answers >= _ENOUGH else 0.0

    def ahead(self, now: float) -> float:
        """Return how far [m] the latest command is, at a time [s], from what the controller has taken before it.

        0 where each was taken in its tick: those that are not yet expected back count as taken, if a state came since.
        """
        if not self._commands:
            return 0.0
        first, *others = self._commands
        if any(command.sent <= now - self._usual + _NOW for command in others):
            return math.dist(self._commands[-1].place.tolist(), first.place.tolist())
        taken = next((command for command in reversed(others) if command.sent < now - _NOW), first)
        return math.dist(self._commands[-1].place.tolist(), taken.place.tolist())

    def silence(self, now: float) -> float:
        """For how long [s] commands are on their way and none has arrived."""
        if not self._sent or self._heard == self._sent % _NUMBERS:
            return 0.0
        return max(now - self._since, 0.0)


class ReadBack:
    """A connection that reads the register back, of which the client library shows nothing.

    Raises RuntimeError where the controller does not, or does not answer within 1 s.
    """

    def __init__(self, host: str) -> None:
        self._buffer = bytearray()
        self.wrong_size: tuple[int, int] | None = None  # bytes of a state, and how many were agreed on
        try:
            self._link = socket.create_connection((host, RTDE), _TIMEOUT)
        except OSError as error:
            raise RuntimeError(f"the controller does not read commands back: {error}") from error
        try:
            self._begin()
        except (OSError, RuntimeError) as error:
            self.close()
            raise RuntimeError(str(error)) from error

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    def _begin(self) -> None:
        if self._ask("V", struct.pack(">H", 2)) != b"\1":
            raise RuntimeError("the controller does not speak RTDE version 2")
        types = self._ask("O", struct.pack(">d", 500.0) + f"timestamp,{_REGISTER}".encode())[1:]
        if types != b"DOUBLE,DOUBLE":
            raise RuntimeError(f"the controller does not read {_REGISTER} back, by which lost commands are noticed")
        if self._ask("S") != b"\1":
            raise RuntimeError("the controller refuses to start sending its state")
        self._link.setblocking(False)

    def _ask(self, kind: str, payload: bytes = b"") -> bytes:
        """Return the answer to a packet; texts and data between the two are skipped."""
        self._link.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)
        while True:
            for answer, content in self._packets():
                if answer == kind:
                    return content
            if not (data := self._link.recv(4096)):
                raise RuntimeError("the controller has closed a link while connecting")
            self._buffer += data

    def _packets(self) -> Iterator[tuple[str, bytes]]:
        while len(self._buffer) >= 3:
            size, kind = struct.unpack_from(">HB", self._buffer)
            if len(self._buffer) < max(size, 3):
                return
            content = bytes(self._buffer[3:size])
            del self._buffer[: max(size, 3)]
            yield chr(kind), content

    def latest(self) -> tuple[float, float] | None:
        """Controller's time [s] and register of the newest state; None without a new one."""
        try:
            while data := self._link.recv(65536):
                self._buffer += data
        except OSError:  # nothing more now, or ever again, which the silence shows
            pass
        states = [content for kind, content in self._packets() if kind == "U"]
        values = [content for content in states if len(content) == STATE_BYTES]
        if len(values) < len(states):
            self.wrong_size = next(len(content) for content in states if len(content) != STATE_BYTES), STATE_BYTES
        return _RECIPE.unpack(values[-1])[1:] if values else None
