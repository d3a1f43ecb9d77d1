"""Datagrams from the run to the page: messages, each whole in one, which browsers get as they are.

A message is a header in JSON. One with rows has numbers behind it: the length of the header (uint32), the header,
filled up with blanks so that the numbers begin at a multiple of 8 bytes, times (n,) as float64, columns (columns, n) as
float32, all little-endian.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

LARGEST = 32_000  # bytes of a datagram: Linux cuts longer ones of such a socket into several
_TIME_BYTES, _NUMBER_BYTES = 8, 4  # of a float64 and of a float32
_HEADER_BYTES = 1000  # that are kept free for the header: a choice
_LENGTH = struct.Struct("<I")
_TEXT = b"{"  # begins a message without numbers; no length does: each is 4 more than a multiple of 8

Header = dict[str, Any]
Rows = tuple[Floats, NDArray[np.float32]]  # times (n,), columns (columns, n)


def pack(header: Mapping[str, Any]) -> bytes:
    """Return a message without numbers."""
    return json.dumps(header, separators=(",", ":"), allow_nan=False).encode()


def pack_rows(header: Mapping[str, Any], time: Floats, columns: NDArray[np.float32]) -> bytes:
    """Return a message with rows: times (n,) [s] and columns (columns, n)."""
    text = pack({**header, "rows": len(time)})
    text += b" " * (-(len(text) + _LENGTH.size) % _TIME_BYTES)
    return _LENGTH.pack(len(text)) + text + time.astype("<f8").tobytes() + columns.astype("<f4").tobytes()


def unpack(message: bytes) -> tuple[Header, Rows | None]:
    """Return a message's header, and its rows where it has some."""
    if message[:1] == _TEXT:
        return json.loads(message), None
    (length,) = _LENGTH.unpack_from(message)
    begin = _LENGTH.size + length
    header = json.loads(message[_LENGTH.size : begin])
    rows = header["rows"]
    time = np.frombuffer(message, "<f8", rows, begin)
    columns = np.frombuffer(message, "<f4", offset=begin + _TIME_BYTES * rows)
    return header, (time, columns.reshape(-1, rows) if rows else columns.reshape(0, 0))


def is_text(message: bytes) -> bool:
    """Return True if a message is only a header."""
    return message[:1] == _TEXT


def pieces(rows: int, columns: int) -> Iterator[slice]:
    """Yield so many rows in pieces that fit into one datagram each."""
    rows_at_once = max((LARGEST - _HEADER_BYTES) // (_TIME_BYTES + _NUMBER_BYTES * max(columns, 1)), 1)
    for begin in range(0, rows, rows_at_once):
        yield slice(begin, min(begin + rows_at_once, rows))
