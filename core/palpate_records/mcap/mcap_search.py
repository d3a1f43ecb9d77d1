"""Search for records of an MCAP file behind damage, by their content alone."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO

import numpy as np

from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_records import Damage

_WINDOW_SIZE = 1 << 22  # [bytes] that are searched at once: a choice
_OVERLAP = 64  # [bytes] of two windows: more than the head of a chunk, up to the length of its data
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_CHAIN_RECORDS = 4  # in a row, that are trusted without a checksum: a choice
# Of the format (MCAP 1.0).
_FIXED_LENGTHS = {records.FOOTER: 20, records.DATA_END: 4, 0x0E: 17}  # [bytes] of the content, by opcode
_OPCODES = frozenset(range(1, 16))
_WORD = 8  # [bytes] of a length
_CHUNK_FIELDS_SIZE = 32  # [bytes] of a chunk's content before the name of its compression
_NAME_BEGIN = records.RECORD_HEAD + _CHUNK_FIELDS_SIZE  # [bytes] of that name, from the begin of the record


def chunks_from(file: IO[bytes], begin: int, end: int) -> Iterator[int]:
    """Yield the offsets in [begin, end) of heads of chunks that agree with themselves.

    The length of a chunk's record and that of the data in it differ by the head: 64 bits that damage does not make. A
    head is an opcode, a length (at 1), fields, the name of the compression, and the length of the data.
    """
    for start, data in _windows(file, begin, end):
        count = len(data) - _NAME_BEGIN - max(map(len, _COMPRESSIONS)) - _WORD
        if count < 1:
            return
        # The 64 bits at every offset as a number: lengths of a record and of its data, by the name between them.
        numbers = np.ndarray((len(data) - _WORD + 1,), "<u8", data, strides=(1,))
        opcodes = np.frombuffer(data, np.uint8)
        is_head = np.zeros(count, bool)
        for name in _COMPRESSIONS:
            name_end = _NAME_BEGIN + len(name)
            data_lengths = numbers[name_end : name_end + count]
            head_size = _CHUNK_FIELDS_SIZE + len(name) + _WORD
            is_head |= numbers[1 : 1 + count] == data_lengths + np.uint64(head_size)
        for offset in np.flatnonzero(is_head & (opcodes[:count] == records.CHUNK)).tolist():
            if start + offset < end and _is_chunk(data, offset, end - start):
                yield start + offset


def _is_chunk(data: bytes, offset: int, size: int) -> bool:
    """Return True if the head of a chunk at an offset has a known compression and lengths that fit in `size` bytes."""
    (length,) = struct.unpack_from("<Q", data, offset + 1)
    (name_length,) = struct.unpack_from("<I", data, offset + _NAME_BEGIN - 4)
    name_begin = offset + _NAME_BEGIN
    name = data[name_begin : name_begin + name_length] if name_length <= len(b"zstd") else None
    if name not in _COMPRESSIONS or offset + records.RECORD_HEAD + length > size:
        return False
    (data_length,) = struct.unpack_from("<Q", data, name_begin + name_length)
    return bool(data_length + _CHUNK_FIELDS_SIZE + name_length + _WORD == length)


def loose_from(file: IO[bytes], begin: int, end: int) -> Iterator[int]:
    """Yield the offsets in [begin, end) of messages outside chunks that plausible records follow."""
    for start, data in _windows(file, begin, end):
        count = len(data) - 2 * _WORD
        if count < 1:
            return
        lengths = np.ndarray((len(data) - _WORD + 1,), "<u8", data, strides=(1,))[1 : 1 + count]
        opcodes = np.frombuffer(data, np.uint8)[:count]
        is_head = opcodes == records.MESSAGE
        is_head &= (lengths >= records.HEAD - records.RECORD_HEAD) & (lengths < records.LIMIT)
        for offset in np.flatnonzero(is_head).tolist():
            if start + offset < end and follows(file, start + offset, end):
                yield start + offset


def follows(file: IO[bytes], position: int, size: int) -> bool:
    """Return True if a few plausible records in a row begin at a position, or fewer up to the end of the file."""
    for _ in range(_CHAIN_RECORDS):
        file.seek(position)
        head = file.read(records.RECORD_HEAD)
        if head[: len(records.MAGIC)] == records.MAGIC:
            return True
        try:
            _, length = plausible_record(head, size - position - records.RECORD_HEAD)
        except Damage:
            return False
        position += records.RECORD_HEAD + length
        if position == size:
            return True
    return True


def plausible_record(head: bytes, remaining: int) -> tuple[int, int]:
    """Return opcode and length of a record by its head; raises Damage if it cannot be one.

    `remaining` is the size [bytes] of the file behind the head.
    """
    if len(head) < records.RECORD_HEAD:
        raise Damage("it ends within a record")
    opcode, length = records.RECORD.unpack(head)
    if length > remaining:
        raise Damage(f"a record claims {length} bytes, more than the file has")
    if opcode not in _OPCODES:
        raise Damage(f"a record has the unknown kind {opcode}")
    is_short_message = opcode == records.MESSAGE and length < records.HEAD - records.RECORD_HEAD
    if _FIXED_LENGTHS.get(opcode, length) != length or is_short_message:
        raise Damage(f"a record of the kind {opcode} claims {length} bytes")
    return opcode, length


def likely(opcode: int, length: int) -> bool:
    """Return True for the head of a record that can be one, whether the file has all of it or not."""
    return opcode in _OPCODES and length <= records.LIMIT


def data_end_from(file: IO[bytes], begin: int, end: int) -> int | None:
    """Return the offset in [begin, end) of the record that ends the data; None without one."""
    head = records.RECORD.pack(records.DATA_END, _FIXED_LENGTHS[records.DATA_END])
    for start, data in _windows(file, begin, end):
        offset = data.find(head)
        while offset >= 0:
            if follows(file, start + offset, end):
                return start + offset
            offset = data.find(head, offset + 1)
    return None


def _windows(file: IO[bytes], begin: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Yield begin and content of pieces that overlap by the head of a chunk."""
    while begin < end:
        file.seek(begin)
        data = file.read(min(_WINDOW_SIZE, end - begin) + _OVERLAP)
        yield begin, data
        begin += _WINDOW_SIZE
