"""Frames of the SensONE in RUN mode: 37 bytes, little-endian, packed."""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass

FRAME = struct.Struct("<BH6fIfH")  # header, status, wrench [N, Nm], time-stamp [us], temperature [deg C], CRC
LENGTH = FRAME.size
HEADER = 0xAA  # first byte of a frame (Bota Systems, manual of the SensONE, serial interface)
_CRC_BYTES, _STATUS_BITS = 2, 4  # at the end of a frame; of the status that have a meaning
_ONES = 0xFFFF  # start and final xor of the CRC
_SECOND = 1e6  # [us]
THROTTLED, OVERRANGE, INVALID, RAW = 1, 2, 4, 8  # bits of the status
UNUSABLE = OVERRANGE | INVALID | RAW

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_REMAINDER = 0x1D0F  # of a message that is followed by its own CRC, a property of the polynomial
_WRAP = 1 << 32  # [us] of the sensor's counter
_FOLLOWS = 2_000_000  # [us] between frames that belong together, at most: a choice
_RESTART = 5_000_000  # [us]; a longer step is not a pause but a restart: a choice
_PLAUSIBLE_WRENCH = 1e5  # [N], [N m]; far beyond any range: a choice, which only random bytes exceed
_PLAUSIBLE_TEMPERATURE = (-55.0, 150.0)  # [deg C] of silicon sensors


def crc_x25(data: bytes) -> int:
    """Return CRC-16/X-25 (reflected polynomial 0x8408, start and final xor 0xFFFF).

    >>> hex(crc_x25(b"123456789"))
    '0x906e'
    """
    # hqx is the same polynomial unreflected: turn the bits of every byte, and of the answer.
    raw = binascii.crc_hqx(data.translate(_REVERSED), _ONES) ^ _ONES
    return int(f"{raw:016b}"[::-1], 2)


def pack_frame(status: int, wrench: tuple[float, ...], stamp: int, temperature: float) -> bytes:
    """Return a frame with its CRC."""
    body = FRAME.pack(HEADER, status, *wrench, stamp % _WRAP, temperature, 0)[:-_CRC_BYTES]
    return body + crc_x25(body[1:]).to_bytes(_CRC_BYTES, "little")


@dataclass(frozen=True)
class Frame:
    """One reading."""

    status: int
    wrench: tuple[float, ...]  # (6,) [N, Nm]
    stamp: int  # [us] of the sensor's 32-bit counter
    temperature: float  # [deg C]


class FrameDecoder:
    """Finds the frames in a stream of bytes, whatever else is in it, and loses no frame that is intact.

    In step, a frame needs its header and CRC. Out of step every 0xAA may begin a frame: it needs plausible content and
    a time-stamp that follows the last one as well, or an intact frame right behind it.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._in_step = False
        self._last: int | None = None
        self.damaged = 0  # times that the stream fell out of step
        self.skipped = 0  # bytes that belonged to no frame

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames that have become whole with new bytes; count damaged frames and skipped bytes.

        In step with the sensor an intact frame is enough; out of step its stamp must follow that of the last one, or an
        intact frame be right behind it.
        """
        buffer = self._bytes
        buffer += data
        frames: list[Frame] = []
        start = 0
        while len(buffer) - start >= LENGTH:
            frame = _intact(buffer, start)
            if frame is not None and not self._in_step and not self._follows(frame):
                if len(buffer) - start < 2 * LENGTH:
                    break  # only the frame behind it decides
                frame = frame if _intact(buffer, start + LENGTH) else None
            if frame is not None:
                frames.append(frame)
                self._in_step, self._last = True, frame.stamp
                start += LENGTH
                continue
            self.damaged += self._in_step
            self._in_step = False
            next_start = buffer.find(HEADER, start + 1)
            next_start = len(buffer) if next_start < 0 else next_start
            self.skipped += next_start - start
            start = next_start
        del buffer[:start]
        return frames

    def _follows(self, frame: Frame) -> bool:
        """Return True if the time-stamp of a frame is shortly after that of the last one."""
        return self._last is not None and 0 < (frame.stamp - self._last) % _WRAP <= _FOLLOWS


def _intact(buffer: bytearray, start: int) -> Frame | None:
    """Return the frame that begins at a place of a buffer; None where header, CRC or content are not of one."""
    if buffer[start] != HEADER:
        return None
    mirrored = buffer[start + 1 : start + LENGTH].translate(_REVERSED)
    if len(mirrored) != LENGTH - 1 or binascii.crc_hqx(mirrored, _ONES) != _REMAINDER:
        return None
    _, status, *wrench, stamp, temperature, _ = FRAME.unpack_from(buffer, start)
    low, high = _PLAUSIBLE_TEMPERATURE
    if status >> _STATUS_BITS or not low <= temperature <= high:
        return None
    if not status & (INVALID | RAW) and not all(abs(value) < _PLAUSIBLE_WRENCH for value in wrench):
        return None
    return Frame(status, tuple(wrench), stamp, temperature)


class TimestampUnwrapper:
    """Counter of microseconds of 32 bits, unwrapped; distinguishes a restart from a wrap."""

    def __init__(self) -> None:
        self.last: int | None = None  # [us] as the sensor has it
        self._total = 0

    def add(self, stamp: int) -> int | None:
        """Return the microseconds since the first stamp; None where the counter restarted."""
        if self.last is not None:
            step = (stamp - self.last) % _WRAP
            if step > _RESTART:
                return None
            self._total += step
        self.last = stamp
        return self._total

    def backwards(self, stamp: int) -> float:
        """Return how far [s] a stamp is before the last one."""
        return 0.0 if self.last is None else ((self.last - stamp) % _WRAP) / _SECOND
