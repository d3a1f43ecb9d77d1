"""The ends of tables, from the pages of a damaged SQLite database.

Format: https://www.sqlite.org/fileformat2.html, section 1.6. A page of a table's tree is a leaf, with rows, or points
to others, each with the largest number of a row that is found there; behind the last such number there is one more.
"""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path
from typing import BinaryIO

_POINTERS, _LEAF = 5, 13  # kinds of pages
_FIRST = 100  # [bytes] of the first page that are the file's own
_DEEPEST = 20


def last_reachable(database: sqlite3.Connection, file: Path, table: str, number: str) -> int | None:
    """The number beyond which no row of a table can be read, for the page that they are on is damaged; None if unknown.

    `number` is the column that shall be the rows' own number: an INTEGER PRIMARY KEY. Raises sqlite3.Error.
    """
    (size,) = database.execute("PRAGMA page_size").fetchone()
    (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    keys = [(row[1], str(row[2]).upper()) for row in database.execute(f"PRAGMA table_info({table})") if row[5]]
    if keys != [(number, "INTEGER")]:
        return None
    with file.open("rb") as pages:
        return _last(pages, size, root)


def _last(pages: BinaryIO, size: int, page: int) -> int | None:
    """Follow the last pointers down from a page; numbers that are damaged need not be in order."""
    largest = None
    for _ in range(_DEEPEST):
        pages.seek((page - 1) * size)
        data, start = pages.read(size), _FIRST if page == 1 else 0
        kind = data[start : start + 1]
        if kind != bytes([_POINTERS]):
            return None if kind == bytes([_LEAF]) else largest
        count, page = struct.unpack_from(">3xH3xI", data, start)
        if not 0 < count <= size // 2 or page < 1:
            return None
        cells = struct.unpack_from(f">{count}H", data, start + 12)
        numbers = [_number(data[cell + 4 : cell + 13]) for cell in cells]
        largest = max(number for number in (largest, *numbers) if number is not None)
    return None


def _number(data: bytes) -> int:
    """Return a number of 1 to 9 bytes, of which each but the ninth flags whether another follows."""
    value = 0
    for byte in data[:8]:
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value
    value = value << 8 | int.from_bytes(data[8:9])
    return value - (1 << 64) if value >> 63 else value
