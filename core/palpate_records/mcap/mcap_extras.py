"""Attachments and metadata of an MCAP log, with the checksums of attachments."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from palpate_records.log_files import readable
from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_records import Damage

_MAX_SIZE = 1 << 22  # [bytes] of one of them that is read: a choice
_MAX_RECORDS = 10_000  # that are read before the first messages: a choice
_LENGTH = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")


@dataclass(frozen=True)
class Attachment:
    """A file within a log."""

    logged: int  # [ns]
    created: int  # [ns]
    name: str
    kind: str  # its media type
    content: bytes


def read_attachment(record: bytes) -> Attachment:
    """Return an attachment from its record's content; raises Damage if it is not whole, or its checksum is wrong."""
    try:
        logged, created = struct.unpack_from("<QQ", record)  # [ns], in 16 bytes
        name, end = records.read_text(record, 16)
        kind, end = records.read_text(record, end)
        (length,) = _LENGTH.unpack_from(record, end)
        (crc,) = _CHECKSUM.unpack(record[-_CHECKSUM.size :])
    except struct.error as error:
        raise Damage("an attachment is shorter than its fields") from error
    content = record[end + _LENGTH.size : -_CHECKSUM.size]
    if length != len(record) - end - _LENGTH.size - _CHECKSUM.size:
        raise Damage("an attachment has another length than it claims")
    if crc and zlib.crc32(record[: -_CHECKSUM.size]) != crc:
        raise Damage("an attachment's checksum is wrong")
    return Attachment(logged, created, name, kind, content)


def read_metadata(record: bytes) -> tuple[str, dict[str, str]]:
    """Return the name and entries of metadata from their record's content; raises Damage if they are not whole."""
    name, end = records.read_text(record, 0)
    packed_entries, _ = records.read_bytes(record, end)
    return name, records.read_entries(packed_entries)


def head_extras(path: Path) -> list[tuple[int, bytes]]:
    """Return opcode and content of the whole attachments and metadata before the first message.

    Raises LogError for a file that cannot be read.
    """
    extras = []
    with readable(path) as file:
        if file.read(len(records.MAGIC)) != records.MAGIC:
            return []
        for _ in range(_MAX_RECORDS):
            head = file.read(records.RECORD.size)
            if len(head) < records.RECORD.size:
                break
            opcode, length = records.RECORD.unpack(head)
            # The head ends with the first message, or with damage.
            if opcode in (records.CHUNK, records.MESSAGE, records.DATA_END) or length > records.LIMIT:
                break
            if opcode not in records.EXTRAS or length > _MAX_SIZE:
                file.seek(length, 1)
                continue
            content = file.read(length)
            if len(content) < length:
                break
            extras.append((opcode, content))
    return extras
