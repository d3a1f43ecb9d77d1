"""Numbers of commands, which the controller reads back: they show which commands have arrived."""

from __future__ import annotations

import math
import socket
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from palpate import Floats
from palpate_kit.protocols.ur_dashboard import RTDE

# `servoL` sends an acceleration that neither the control program nor `servoj` uses: the command's number goes there
# (0213).
_REGISTER = "input_double_register_7"
_UNIT = 1e-3  # [m/s^2] of a number 1
_NUMBERS = 1 << 15  # they repeat: the client library takes up to 40 m/s^2, the limit of a joint [rad/s^2]
# Choices.
_TIMEOUT = 1.0  # [s] of the connection and of each answer
_MAX_PENDING = 64  # commands, 0.13 s of them: a link is lost after 0.1 s
_SAME_INSTANT = 0.5e-3  # [s] within which two instants are one: a quarter of a tick
_MIN_ANSWERS = 16  # commands that came back: a computer that was held up makes one of them late, not all
# RTDE, version 2: a packet is its size, a letter for its kind, and its content.
_VERSION = 2
_HEADER_BYTES = 3
_RATE = 500.0  # [Hz] of the states that are asked for, the controller's own
_ANSWER_BYTES = 4096  # that are read at once while connecting
_STATES_BYTES = 1 << 16  # that are read at once from then on: over 3000 states
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
        self._sent = 0  # commands so far
        self._heard: int | None = None  # the latest number that came back
        self._since = 0.0  # [s] of the latest news, or of the first command after which there was none to come
        self._commands: deque[_SentCommand] = deque(maxlen=_MAX_PENDING)  # from the latest that came back on
        self._shortest_answer = math.inf  # [s] in which a command came back
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
        """Take over the number that the controller read back, as an acceleration [m/s^2], at a time [s]."""
        heard = round(acceleration / _UNIT)
        if heard == self._heard:
            return
        self._heard, self._since = heard, now
        # Commands before that number were taken, or overtaken by it.
        if any(command.number == heard for command in self._commands):
            while self._commands[0].number != heard:
                self._commands.popleft()
            self._shortest_answer = min(self._shortest_answer, now - self._commands[0].sent)
            self._answers += 1

    @property
    def answer_time(self) -> float:
        """The shortest time [s] in which a command came back; 0 before enough of them did."""
        return self._shortest_answer if self._answers >= _MIN_ANSWERS else 0.0

    def ahead(self, now: float) -> float:
        """Return how far [m] the latest command is, at a time [s], from what the controller has taken before it.

        0 where each was taken in its tick: those that are not yet expected back count as taken, if a state came since.
        """
        if not self._commands:
            return 0.0
        answered_command, *pending = self._commands
        latest = self._commands[-1]
        # One that should have come back has not: nothing since the answered one, the first that is kept, counts as
        # taken.
        if any(command.sent <= now - self._shortest_answer + _SAME_INSTANT for command in pending):
            return math.dist(latest.place.tolist(), answered_command.place.tolist())
        # Else the last one that was sent before the newest state.
        latest_taken = answered_command
        for command in pending:
            if command.sent < now - _SAME_INSTANT:
                latest_taken = command
        return math.dist(latest.place.tolist(), latest_taken.place.tolist())

    def silence(self, now: float) -> float:
        """Return for how long [s], at a time [s], commands have been on their way without one that arrived."""
        if not self._sent or self._heard == self._sent % _NUMBERS:
            return 0.0
        return max(now - self._since, 0.0)


class ReadBack:
    """A connection that reads the register back, of which the client library shows nothing.

    Raises RuntimeError where the controller does not, or does not answer within 1 s.
    """

    def __init__(self, host: str) -> None:
        """Connect to a controller and agree on the commands to be read back; raises RuntimeError."""
        self._buffer = bytearray()
        self.wrong_size: tuple[int, int] | None = None  # [bytes] of a state, and those agreed on
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
        """Agree on the version and on the states, and let the controller send; raises OSError, RuntimeError."""
        if self._ask("V", struct.pack(">H", _VERSION)) != b"\1":
            raise RuntimeError(f"the controller does not speak RTDE version {_VERSION}")
        types = self._ask("O", struct.pack(">d", _RATE) + f"timestamp,{_REGISTER}".encode())[1:]
        if types != b"DOUBLE,DOUBLE":
            raise RuntimeError(f"the controller does not read {_REGISTER} back, by which lost commands are noticed")
        if self._ask("S") != b"\1":
            raise RuntimeError("the controller refuses to start sending its state")
        self._link.setblocking(False)

    def _ask(self, kind: str, payload: bytes = b"") -> bytes:
        """Return the answer to a packet; texts and data between the two are skipped."""
        self._link.sendall(struct.pack(">HB", _HEADER_BYTES + len(payload), ord(kind)) + payload)
        while True:
            for answer, content in self._packets():
                if answer == kind:
                    return content
            if not (data := self._link.recv(_ANSWER_BYTES)):
                raise RuntimeError("the controller has closed a link while connecting")
            self._buffer += data

    def _packets(self) -> Iterator[tuple[str, bytes]]:
        """Yield kind and content of every whole packet that has arrived, and take it out of the buffer."""
        while len(self._buffer) >= _HEADER_BYTES:
            size, kind = struct.unpack_from(">HB", self._buffer)
            whole_size = max(size, _HEADER_BYTES)  # a size that is less than its header is a damaged one
            if len(self._buffer) < whole_size:
                return
            content = bytes(self._buffer[_HEADER_BYTES:size])
            del self._buffer[:whole_size]
            yield chr(kind), content

    def latest(self) -> tuple[float, float] | None:
        """Return the controller's time [s] and the register of the newest state; None without a new one."""
        try:
            while data := self._link.recv(_STATES_BYTES):
                self._buffer += data
        except OSError:  # nothing more now, or ever again, which the silence shows
            pass
        newest = None
        wrong_size = None
        for kind, state in self._packets():
            if kind != "U":
                continue
            if len(state) == STATE_BYTES:
                newest = state
            elif wrong_size is None:
                wrong_size = len(state)
        if wrong_size is not None:
            self.wrong_size = wrong_size, STATE_BYTES
        return _RECIPE.unpack(newest)[1:] if newest is not None else None
