"""What an MCAP log carries besides its messages: attachments with their checksum, and metadata."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from palpate_records.log_files import readable
from palpate_records.mcap import mcap_records as records
from palpate_records.mcap.mcap_records import Damage

_LARGEST = 1 << 22  # [bytes] of one text
_RECORDS = 10_000  # that are looked at before the first messages


@dataclass(frozen=True)
class Attachment:
    """A file within a log."""

    logged: int  # [ns]
    created: int  # [ns]
    name: str
    kind: str  # its media type
    content: bytes


def read_attachment(record: bytes) -> Attachment:
    """Return an attachment from its record's content; raises Damage where it is not whole, or its checksum is wrong."""
    try:
        logged, created = struct.unpack_from("<QQ", record)
        name, at = records.read_text(record, 16)
        kind, at = records.read_text(record, at)
        length, crc = *struct.unpack_from("<Q", record, at), *struct.unpack("<I", record[-4:])
    except struct.error as error:
        raise Damage("an attachment is shorter than its fields") from error
    if length != len(record) - at - 12:
        raise Damage("an attachment has another length than it claims")
    if crc and zlib.crc32(record[:-4]) != crc:
        raise Damage("an attachment's checksum is wrong")
    return Attachment(logged, created, name, kind, record[at + 8 : -4])


def read_metadata(record: bytes) -> tuple[str, dict[str, str]]:
    """Return the name and entries of metadata from their record's content; raises Damage where they are not whole."""
    name, at = records.read_text(record, 0)
    packed, _ = records.read_bytes(record, at)
    entries, at = {}, 0
    while at < len(packed):
        key, at = records.read_text(packed, at)
        entries[key], at = records.read_text(packed, at)
    return name, entries


def head_extras(path: Path) -> list[tuple[int, bytes]]:
    """Opcode and content of the attachments and metadata ahead of the first message; of a damaged head, what is whole.

    Raises LogError where the file cannot be read.
    """
    found = []
    with readable(path) as file:
        if file.read(len(records.MAGIC)) != records.MAGIC:
            return []
        for _ in range(_RECORDS):
            head = file.read(records.RECORD.size)
            if len(head) < records.RECORD.size:
                break
            opcode, length = records.RECORD.unpack(head)
            if opcode in (records.CHUNK, records.MESSAGE, records.DATA_END) or length > records.LIMIT:
                break
            if opcode not in records.EXTRAS or length > _LARGEST:
                file.seek(length, 1)
                continue
            content = file.read(length)
            if len(content) < length:
                break
            found.append((opcode, content))
    return found
