"""A SensONE in software, on a pseudo-terminal."""

from __future__ import annotations

import math
import re

import numpy as np
from palpate import Floats
from palpate_kit.protocols.bota_frames import LENGTH, pack_frame

from palpate_simulation.twins.delay_line import DelayLine
from palpate_simulation.twins.frame_corruption import KINDS, corrupt_frame
from palpate_simulation.twins.sensor_lines import SerialLine

_BOOT, _SLOW_BOOT = 0.3, 2.5  # [s]; a choice, the real sensor takes less than 3 s
_REPLY = 0.01  # [s]; a choice
_QUIET = 0.03  # [s] of silence end a command that has no line end; a choice
_TEXT = b"App Init\r\nname: BFT-SENS-SER-M8 (software)\r\nS/N: 000000\r\nFW version: 2.3 software\r\n"
_FACTORY_SINC = 512
_MOST_UNSENT = 100_000  # bytes, some 3 s: a pseudo-terminal takes 0.5 s of frames, then nothing until it is read
_STATUS = {"throttled": 1, "overrange": 2, "saturated": 4, "raw": 8}


class VirtualSensor:
    """State machine of a SensONE: boot, RUN, CONFIG; commands, acknowledgements, frames.

    It resets when its port is opened, as the real one does by DTR, comes up at its stored settings and streams by
    itself. Which wrench it reads is not its business: `instants` gives
    its sampling times, `send` gets its readings.
    """

    def __init__(self, line: SerialLine, overhead: float, ppm: float, clock_start: int, seed: int) -> None:
        self._line = line
        self._overhead = overhead
        self._rate = 1.0 + ppm * 1e-6
        self._clock_start = clock_start
        self._rng = np.random.default_rng(seed)
        self._stored = {"sinc": _FACTORY_SINC}
        self.eeprom_writes = 0
        self.sent = self.dropped = 0
        self.fault: str | None = None  # "silent", or a name of a status bit
        self.reply_time, self.lump_time = _REPLY, 0.0  # [s]
        self._held, self._sent_at = b"", 0.0  # frames that wait for their lump
        self._unsent = b""  # what the terminal did not take
        self.delay: DelayLine[bytes] = DelayLine()  # on the line
        self._misheard = False  # the port was opened at another baud rate
        self.corruption = 0.0
        self.sign = 1.0
        self._mode = "closed"
        self._sinc = _FACTORY_SINC
        self._command = b""
        self._replies: list[tuple[float, bytes]] = []
        self._heard = self._boot_at = self._booted = self._next = 0.0
        self._refuse = ""
        self.plug_in()

    def plug_in(self) -> None:
        """Put the cable in."""
        self._line.plug_in()
        self._mode = "closed"

    def unplug(self) -> None:
        """Take the cable out."""
        self._line.unplug()
        self._mode = "unplugged"

    def end(self) -> None:
        """Hang up; the port can be opened again."""
        self.unplug()
        self.plug_in()

    @property
    def period(self) -> float:
        """Time between readings [s]: sinc length over 51200 Hz, and what the line takes."""
        return self._sinc / 51200.0 + self._overhead

    @property
    def noise_factor(self) -> float:
        """How much noisier than at a sinc length of 64 (from the maker's tolerances: sigma goes with N^-0.72)."""
        return math.pow(self._sinc / 64.0, -0.72)

    def reboot(self, now: float) -> None:
        """Restart, with the stored settings."""
        boot = _SLOW_BOOT if self.reply_time > _REPLY else _BOOT
        self._mode, self._boot_at, self._command, self._replies, self._held = "boot", now + boot, b"", [], b""
        self._unsent = b""
        self._sinc = self._stored["sinc"]

    def restore(self) -> None:
        """Plugged in, and without a fault."""
        self.fault, self.corruption, self.sign, self._refuse = None, 0.0, 1.0, ""
        self.reply_time, self.lump_time = _REPLY, 0.0
        self.delay.clear()
        if self._mode == "unplugged":
            self.plug_in()

    def refuse(self, letter: str) -> None:
        """Answer a command with code 1 from now on."""
        self._refuse = letter

    def poll(self, now: float) -> None:
        """Opening and closing, commands and answers; `now` [s] is the world's time."""
        if self._mode == "unplugged":
            return
        is_open, data = self._line.look()
        if not is_open:
            self._mode = "closed"
            return
        if self._mode == "closed":
            self.reboot(now)
        self._misheard = self._line.misheard
        if data:
            self._take(data, now)
        if self._command and now - self._heard > _QUIET:
            self._take(b"\n", now)
        if self._mode == "boot" and now >= self._boot_at:
            self._write(_TEXT)
            self._mode, self._booted, self._next = "run", now, now
        for data in self.delay.take(now) if self._mode == "run" else ():
            self._write(data)
        while self._replies and self._replies[0][0] <= now:
            self._write(self._replies.pop(0)[1])

    def _take(self, data: bytes, now: float) -> None:
        self._heard = now
        if self._mode == "boot" or self._misheard:
            return
        self._command += data
        *lines, self._command = re.split(rb"[\r\n]", self._command)
        for line in lines:
            if line:
                self._obey(line.decode(errors="replace"), now)

    def _obey(self, line: str, now: float) -> None:
        letter, code = line[0], 0
        if letter == "#":
            self.reboot(now)
            return
        if letter in ("C", "I"):
            self._mode = "config" if letter == "C" else "init"
        elif self._mode == "run":
            return  # only C, I and # are heard in RUN
        elif letter == "R":
            self._mode, self._next = "run", now
        elif letter == "f":
            code = self._filter(line)
        elif letter == "s":
            self._stored["sinc"] = self._sinc
            self.eeprom_writes += 1
        elif letter not in "cbmlw":
            code = 1
        if letter == self._refuse:
            code = 1
        self._replies.append((now + self.reply_time, f"r,0,{letter},{code}\r\n".encode()))

    def _filter(self, line: str) -> int:
        numbers = line.split(",")[1:]
        if len(numbers) != 4 or not all(text.isdigit() for text in numbers) or not 51 <= int(numbers[0]) <= 2048:
            return 2
        self._sinc = int(numbers[0])
        return 0

    def instants(self, until: float) -> Floats:
        """Return the times [s] up to `until` at which it reads, since the last call."""
        if self._mode != "run":
            return np.zeros(0)
        count = max(math.floor((until - self._next) / self.period + 1e-9) + 1, 0)
        instants = np.asarray(self._next + self.period * np.arange(count), np.float64)
        self._next += self.period * count
        return instants

    def send(self, instants: Floats, wrench: Floats) -> None:
        """Write the readings (n, 6) taken at instants (n,)."""
        if self.fault == "silent" or self._mode != "run":
            return
        status = _STATUS.get(self.fault or "", 0)
        for instant, reading in zip(instants.tolist(), (self.sign * wrench).tolist(), strict=True):
            stamp = self._clock_start + round((instant - self._booted) * self._rate * 1e6)
            frame = pack_frame(status, tuple(reading), stamp, 30.0)
            if self.corruption and self._rng.random() < self.corruption:
                frame = corrupt_frame(frame, str(self._rng.choice(KINDS)), self._rng)
            self._held += frame
            self.sent += bool(frame)
            self.dropped += not frame
            if instant - self._sent_at >= self.lump_time:
                self._deliver(self._held, instant)
                self._held, self._sent_at = b"", instant

    def _deliver(self, frames: bytes, now: float) -> None:
        if self.delay.is_on:
            self.delay.put(frames, now)
        else:
            self._write(frames)

    def _write(self, data: bytes) -> None:
        if self._misheard:
            data = self._rng.bytes(len(data))
        self._unsent += data
        try:
            self._unsent = self._unsent[self._line.write(self._unsent) :] if self._unsent else b""
        except BlockingIOError:  # the reader does not read, or the machine does not let it
            pass
        except OSError:
            self._mode, self._unsent = "closed", b""
        if len(self._unsent) > _MOST_UNSENT:
            self.dropped += len(self._unsent) // LENGTH
            self._unsent = b""
