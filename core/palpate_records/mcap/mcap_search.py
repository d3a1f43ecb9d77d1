"""Where records of an MCAP file begin behind damage: found by their own content, not by what came before."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO

import numpy as np

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_records import Damage

_WINDOW = 1 << 22  # [bytes] looked through at once
_HEAD = 64  # [bytes] more than the head of a chunk, up to the length of its records
_NAMES = (b"", b"lz4", b"zstd")
_CHAIN = 4  # records in a row that are trusted without a checksum
_FIXED = {records.FOOTER: 20, records.DATA_END: 4, 0x0E: 17}  # length of the content by kind
_KINDS = frozenset(range(1, 16))


def chunks_from(file: IO[bytes], begin: int, end: int) -> Iterator[int]:
    """Offsets in [begin, end) where the head of a chunk agrees with itself.

    The length of a chunk's record and that of the records in it differ by the head: 64 bits that damage does not make.
    """
    for start, data in _windows(file, begin, end):
        count = len(data) - 41 - max(map(len, _NAMES)) - 8
        if count < 1:
            return
        words = np.ndarray((len(data) - 7,), "<u8", data, strides=(1,))
        kinds = np.frombuffer(data, np.uint8)
        found = np.zeros(count, bool)
        for name in _NAMES:
            inner = words[41 + len(name) : 41 + len(name) + count]
            found |= words[1 : 1 + count] == inner + np.uint64(40 + len(name))
        for at in np.flatnonzero(found & (kinds[:count] == records.CHUNK)).tolist():
            if start + at < end and _is_chunk(data, at, end - start):
                yield start + at


def _is_chunk(data: bytes, at: int, left: int) -> bool:
    (length,) = struct.unpack_from("<Q", data, at + 1)
    (name_length,) = struct.unpack_from("<I", data, at + 37)
    name = data[at + 41 : at + 41 + name_length] if name_length < 5 else None
    if name not in _NAMES or at + 9 + length > left:
        return False
    return bool(struct.unpack_from("<Q", data, at + 41 + name_length)[0] + 40 + name_length == length)


def loose_from(file: IO[bytes], begin: int, end: int) -> Iterator[int]:
    """Offsets in [begin, end) where a message outside of chunks begins, and records that fit follow it."""
    for start, data in _windows(file, begin, end):
        count = len(data) - 16
        if count < 1:
            return
        words = np.ndarray((len(data) - 7,), "<u8", data, strides=(1,))[1 : 1 + count]
        kinds = np.frombuffer(data, np.uint8)[:count]
        likely = (kinds == records.MESSAGE) & (words >= records.HEAD - 9) & (words < records.LIMIT)
        for at in np.flatnonzero(likely).tolist():
            if start + at < end and follows(file, start + at, end):
                yield start + at


def follows(file: IO[bytes], position: int, size: int) -> bool:
    """Return True if a few records in a row begin there, or all that are left."""
    for _ in range(_CHAIN):
        file.seek(position)
        head = file.read(9)
        if head[: len(records.MAGIC)] == records.MAGIC:
            return True
        try:
            position += 9 + plausible_record(head, size - position - 9)[1]
        except Damage:
            return False
        if position == size:
            return True
    return True


def plausible_record(head: bytes, left: int) -> tuple[int, int]:
    """Kind and length of a record that can be one; raises Damage."""
    if len(head) < 9:
        raise Damage("it ends within a record")
    opcode, length = records.RECORD.unpack(head)
    if length > left:
        raise Damage(f"a record claims {length} bytes, more than the file has")
    if opcode not in _KINDS:
        raise Damage(f"a record has the unknown kind {opcode}")
    if _FIXED.get(opcode, length) != length or (opcode == records.MESSAGE and length < records.HEAD - 9):
        raise Damage(f"a record of the kind {opcode} claims {length} bytes")
    return opcode, length


def likely(opcode: int, length: int) -> bool:
    """Return True if a record's head can be one, all of it there or not."""
    return opcode in _KINDS and length <= records.LIMIT


def data_end_from(file: IO[bytes], begin: int, end: int) -> int | None:
    """Where the record that ends the data is; None where none is found."""
    mark = records.RECORD.pack(records.DATA_END, 4)
    for start, data in _windows(file, begin, end):
        at = data.find(mark)
        while at >= 0:
            if follows(file, start + at, end):
                return start + at
            at = data.find(mark, at + 1)
    return None


def _windows(file: IO[bytes], begin: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Pieces that overlap by the head of a chunk."""
    while begin < end:
        file.seek(begin)
        data = file.read(min(_WINDOW, end - begin) + _HEAD)
        yield begin, data
        begin += _WINDOW
