"""An RDT box in software: ATI's Net F/T or OnRobot's HEX, on a loopback address."""

from __future__ import annotations

import contextlib
import math

import numpy as np
from palpate import Floats
from palpate_kit.protocols.rdt_packets import PERIOD, REPLY, STOP, STREAM, parse_request

from palpate_simulation.twins.datagram_lines import DatagramLine
from palpate_simulation.twins.delay_line import DelayLine

COUNTS = {"ati": (1e6, 1e6), "onrobot": (1e4, 1e5)}  # per newton and per newton metre, as the device assumes
SEQUENCE_NUMBERS = 1 << 32  # the counter has 32 bits
TIME_ROUNDING = 1e-9  # of a period: a reading so little after a time is still in it
# Status words by fault; any error sets the highest bit.
_STATUS = {"throttled": 0, "overrange": 0x80010000, "saturated": 0x80000002, "raw": 0x80000001}


class VirtualBox:
    """A box that answers requests; `instants` returns its sampling times, `send` takes the readings at them.

    It has the methods of `VirtualSensor`, so that a bench need not know which of them it has.
    """

    noise_factor = 1.0
    eeprom_writes = 0

    def __init__(self, line: DatagramLine, rate: float, scale: tuple[float, float], seed: int) -> None:
        self._line, self.period = line, 1.0 / rate
        self._scale = np.repeat(scale, 3)
        self._rng = np.random.default_rng(seed)
        self._streaming = False
        self._next, self._sequence = 0.0, 0
        self.sent = self.dropped = 0
        self.fault: str | None = None
        self.corruption, self.sign, self.reply_time, self.lump_time = 0.0, 1.0, 0.0, 0.0
        self.delay: DelayLine[bytes] = DelayLine()  # on the net
        self.plug_in()

    def plug_in(self) -> None:
        """Be on the net."""
        self._line.plug_in()

    def unplug(self) -> None:
        """Be off the net."""
        self._line.unplug()
        self._streaming = False

    def end(self) -> None:
        """Serve the listener no longer; another one may ask."""
        self._client = None

    def reboot(self, now: float) -> None:
        """Count from the beginning; listeners continue to be served."""
        self._sequence = 0

    def restore(self) -> None:
        """Be on the net, and end every fault."""
        self.fault, self.corruption, self.sign, self.lump_time = None, 0.0, 1.0, 0.0
        self.delay.clear()
        self.plug_in()

    def refuse(self, letter: str) -> None:
        """Do nothing: the box has a few requests, and refuses none."""

    def poll(self, now: float) -> None:
        """Send the late readings that are due, and take a request, at the world's time [s]."""
        for data in self.delay.take(now):
            self._write(data)
        with contextlib.suppress(OSError):  # no datagram, or a client that has gone
            command, count = parse_request(self._line.receive()) or (None, 0)
            if command == STREAM:
                self._streaming, self._next = True, now
            elif command == STOP:
                self._streaming = False
            elif command == PERIOD and count > 0:
                self.period = count / 1e3

    def instants(self, until: float) -> Floats:
        """Return the sampling times (n,) [s] up to `until`, since the last call."""
        if not self._streaming:
            return np.zeros(0)
        count = max(math.floor((until - self._next) / self.period + TIME_ROUNDING) + 1, 0)
        instants = np.asarray(self._next + self.period * np.arange(count), np.float64)
        self._next += self.period * count
        return instants

    def send(self, instants: Floats, wrench: Floats) -> None:
        """Send the readings (n, 6) [N, N*m] taken at instants (n,) [s], in counts."""
        status = _STATUS.get(self.fault or "", 0)
        rows = np.rint(self.sign * wrench * self._scale).astype(int).tolist()
        for instant, counts in zip(instants.tolist(), rows, strict=True):
            self._sequence = (self._sequence + 1) % SEQUENCE_NUMBERS
            if self.fault == "silent" or not self._streaming:
                continue
            if self.corruption and self._rng.random() < self.corruption:
                self.dropped += 1  # UDP drops what is damaged
                continue
            data = REPLY.pack(self._sequence, self._sequence, status, *counts)
            if self.delay.is_on:
                self.delay.put(data, instant)
            else:
                self._write(data)

    def _write(self, data: bytes) -> None:
        """Send a datagram, if anybody listens."""
        with contextlib.suppress(OSError):
            self._line.send(data)
            self.sent += 1
