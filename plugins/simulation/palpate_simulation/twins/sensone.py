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

_BOOT_TIME, _SLOW_BOOT_TIME = 0.3, 2.5  # [s]; a choice, the real sensor takes less than 3 s
_REPLY_TIME = 0.01  # [s]; a choice
_QUIET_TIME = 0.03  # [s] of silence end a command that has no line end; a choice
_TEXT = b"App Init\r\nname: BFT-SENS-SER-M8 (software)\r\nS/N: 000000\r\nFW version: 2.3 software\r\n"
_SAMPLING_RATE = 51200.0  # [Hz] of the gauges; a reading is the mean of a sinc length of samples
_FACTORY_SINC = 512
_MIN_SINC, _MAX_SINC = 51, 2048
# Noise by the sinc length N, from the maker's tolerances: sigma goes with N^-0.72; the noise is stated for N = 64.
_NOISE_SINC, _NOISE_EXPONENT = 64.0, -0.72
_TEMPERATURE = 30.0  # [C] in every frame (a choice)
_TIME_ROUNDING = 1e-9  # of a period: a reading so little after a time is still in it
_MAX_UNSENT = 100_000  # bytes, some 3 s: a pseudo-terminal takes 0.5 s of frames, then nothing until it is read
_ACCEPTED, _REFUSED, _WRONG_PARAMETERS = 0, 1, 2  # codes of a reply
_PLAIN_COMMANDS = "cbmlw"  # that are accepted, and change nothing here
_STATUS = {"throttled": 1, "overrange": 2, "saturated": 4, "raw": 8}  # bits of a frame by fault


class VirtualSensor:
    """State machine of a SensONE: boot, RUN, CONFIG; commands, acknowledgements, frames.

    It resets when its port is opened, as the real one does by DTR, comes up with its stored settings and streams by
    itself. `instants` returns its sampling times, `send` takes the readings at them. The line adds `overhead` [s] to
    its period; its clock starts at `clock_start` [us] and is wrong by `ppm`.
    """

    def __init__(self, line: SerialLine, overhead: float, ppm: float, clock_start: int, seed: int) -> None:
        """Plug the cable in; the port is still closed. `overhead` [s] is per reading, `clock_start` in microseconds."""
        self._line = line
        self._overhead = overhead
        self._clock_rate = 1.0 + ppm * 1e-6
        self._clock_start = clock_start
        self._rng = np.random.default_rng(seed)
        self._stored = {"sinc": _FACTORY_SINC}
        self.eeprom_writes = 0
        self.sent = self.dropped = 0
        self.fault: str | None = None  # "silent", or a name of a status bit
        self.reply_time, self.lump_time = _REPLY_TIME, 0.0  # [s]
        self._lump, self._lump_start = b"", 0.0  # frames that are sent together, and the time [s] of the lump before
        self._unsent = b""  # bytes that the terminal did not take
        self.delay: DelayLine[bytes] = DelayLine()  # on the line
        self._misheard = False  # the port was opened at another baud rate
        self.corruption = 0.0
        self.sign = 1.0
        self._mode = "closed"  # or unplugged, boot, run, config, init
        self._sinc = _FACTORY_SINC
        self._command = b""  # an incomplete line
        self._replies: list[tuple[float, bytes]] = []  # with the time [s] at which each is sent
        # Times [s] of the last bytes heard, of the end of the boot, of the clock's zero, and of the next reading.
        self._heard = self._boot_at = self._booted = self._next = 0.0
        self._refused_letter = ""
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
        """Time between readings [s]: sinc length over 51200 Hz, and the time of the line."""
        return self._sinc / _SAMPLING_RATE + self._overhead

    @property
    def noise_factor(self) -> float:
        """Noise over that at a sinc length of 64: (N/64)^-0.72, from the maker's tolerances."""
        return math.pow(self._sinc / _NOISE_SINC, _NOISE_EXPONENT)

    def reboot(self, now: float) -> None:
        """Restart, with the stored settings."""
        boot_time = _SLOW_BOOT_TIME if self.reply_time > _REPLY_TIME else _BOOT_TIME
        self._mode, self._boot_at = "boot", now + boot_time
        self._command, self._replies = b"", []
        self._lump = self._unsent = b""
        self._sinc = self._stored["sinc"]

    def restore(self) -> None:
        """Put the cable in, and end every fault."""
        self.fault, self._refused_letter = None, ""
        self.corruption, self.sign = 0.0, 1.0
        self.reply_time, self.lump_time = _REPLY_TIME, 0.0
        self.delay.clear()
        if self._mode == "unplugged":
            self.plug_in()

    def refuse(self, letter: str) -> None:
        """Refuse the command of a letter from now on."""
        self._refused_letter = letter

    def poll(self, now: float) -> None:
        """Notice opening and closing of the port, take commands and send answers, at the world's time [s]."""
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
        # Silence ends a command, too.
        if self._command and now - self._heard > _QUIET_TIME:
            self._take(b"\n", now)
        if self._mode == "boot" and now >= self._boot_at:
            self._write(_TEXT)
            self._mode, self._booted, self._next = "run", now, now
        if self._mode == "run":
            for frames in self.delay.take(now):
                self._write(frames)
        while self._replies and self._replies[0][0] <= now:
            self._write(self._replies.pop(0)[1])

    def _take(self, data: bytes, now: float) -> None:
        """Take bytes of commands at a time [s], and obey those that are complete."""
        self._heard = now
        if self._mode == "boot" or self._misheard:
            return
        self._command += data
        *lines, self._command = re.split(rb"[\r\n]", self._command)
        for line in lines:
            if line:
                self._obey(line.decode(errors="replace"), now)

    def _obey(self, line: str, now: float) -> None:
        """Obey a command, and prepare its reply "r,0,LETTER,CODE".

        #: restart; C: configuration; I: initialization; R: run; f: filter; s: store the settings. A running sensor
        obeys #, C and I alone.
        """
        letter, code = line[0], _ACCEPTED
        if letter == "#":
            self.reboot(now)
            return
        if letter in ("C", "I"):
            self._mode = "config" if letter == "C" else "init"
        elif self._mode == "run":
            return
        elif letter == "R":
            self._mode, self._next = "run", now
        elif letter == "f":
            code = self._set_filter(line)
        elif letter == "s":
            self._stored["sinc"] = self._sinc
            self.eeprom_writes += 1
        elif letter not in _PLAIN_COMMANDS:
            code = _REFUSED
        if letter == self._refused_letter:
            code = _REFUSED
        self._replies.append((now + self.reply_time, f"r,0,{letter},{code}\r\n".encode()))

    def _set_filter(self, line: str) -> int:
        """Set the sinc length by a command "f,SINC,0,FAST,FIR"; return the code of the reply."""
        numbers = line.split(",")[1:]
        if len(numbers) != 4 or not all(text.isdigit() for text in numbers):
            return _WRONG_PARAMETERS
        sinc = int(numbers[0])
        if not _MIN_SINC <= sinc <= _MAX_SINC:
            return _WRONG_PARAMETERS
        self._sinc = sinc
        return _ACCEPTED

    def instants(self, until: float) -> Floats:
        """Return the sampling times (n,) [s] up to `until`, since the last call."""
        if self._mode != "run":
            return np.zeros(0)
        count = max(math.floor((until - self._next) / self.period + _TIME_ROUNDING) + 1, 0)
        instants = np.asarray(self._next + self.period * np.arange(count), np.float64)
        self._next += self.period * count
        return instants

    def send(self, instants: Floats, wrench: Floats) -> None:
        """Write frames of the readings (n, 6) [N, N*m] taken at instants (n,) [s], single or in lumps."""
        if self.fault == "silent" or self._mode != "run":
            return
        status = _STATUS.get(self.fault or "", 0)
        for instant, reading in zip(instants.tolist(), (self.sign * wrench).tolist(), strict=True):
            stamp = self._clock_start + round((instant - self._booted) * self._clock_rate * 1e6)  # [us]
            frame = pack_frame(status, tuple(reading), stamp, _TEMPERATURE)
            if self.corruption and self._rng.random() < self.corruption:
                frame = corrupt_frame(frame, str(self._rng.choice(KINDS)), self._rng)
            self._lump += frame
            self.sent += bool(frame)
            self.dropped += not frame
            if instant - self._lump_start >= self.lump_time:
                self._deliver(self._lump, instant)
                self._lump, self._lump_start = b"", instant

    def _deliver(self, frames: bytes, now: float) -> None:
        """Write frames, or let them be late, where a fault says so."""
        if self.delay.is_on:
            self.delay.put(frames, now)
        else:
            self._write(frames)

    def _write(self, data: bytes) -> None:
        """Write bytes to the line, which reach a reader of another baud rate as noise; keep those that it refuses."""
        self._unsent += self._rng.bytes(len(data)) if self._misheard else data
        try:
            self._unsent = self._unsent[self._line.write(self._unsent) :] if self._unsent else b""
        except BlockingIOError:  # the reader does not read, or the machine does not let it
            pass
        except OSError:
            self._mode, self._unsent = "closed", b""
        if len(self._unsent) > _MAX_UNSENT:
            self.dropped += len(self._unsent) // LENGTH
            self._unsent = b""
