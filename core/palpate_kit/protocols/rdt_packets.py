"""Raw data transfer (RDT) by UDP: a request of 8 bytes, replies of 36, big-endian (ATI, "Net F/T manual", RDT)."""

from __future__ import annotations

import struct

PORT = 49152  # of RDT (ATI, "Net F/T manual")
_REQUEST, REPLY = struct.Struct("!HHI"), struct.Struct("!3I6i")  # sequence, the sensor's own, status, counts
_HEADER = 0x1234  # begins every request
STOP, STREAM, BIAS, PERIOD = 0x0000, 0x0002, 0x0042, 0x0082  # the last: OnRobot's, in milliseconds
_WRAP = 1 << 32  # of the counter of readings


def request(command: int, count: int = 0) -> bytes:
    """Return a request for so many readings, 0 being all that come.

    >>> request(STREAM).hex()
    '1234000200000000'
    """
    return _REQUEST.pack(_HEADER, command, count)


def parse_request(data: bytes) -> tuple[int, int] | None:
    """Return command and count of a request; None for anything else."""
    if len(data) != _REQUEST.size:
        return None
    header, command, count = _REQUEST.unpack(data)
    return (command, count) if header == _HEADER else None


def missing_readings(before: int | None, sequence: int) -> int:
    """Return how many readings lie between two numbers of a 32-bit counter; negative for one that comes late or again.

    >>> missing_readings(2**32 - 1, 2)
    2
    """
    if before is None:
        return 0
    step = (sequence - before) % _WRAP
    return step - 1 if step < _WRAP // 2 else -1
