"""The ends of tables, from the pages of a damaged SQLite database.

Format: https://www.sqlite.org/fileformat2.html, section 1.6. A page of a table's tree is a leaf, with rows, or points
to others, each with the largest number of a row in it; behind the last such number there is one more pointer.
"""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path
from typing import BinaryIO

_POINTER_PAGE, _LEAF_PAGE = 5, 13  # kinds of pages
_FILE_HEAD = 100  # [bytes] at the begin of the first page
_PAGE_HEAD = 12  # [bytes] of a page of pointers
_POINTER_SIZE = 4  # [bytes], before the number of a row
_MAX_DEPTH = 20  # of a tree: a choice


def last_reachable(database: sqlite3.Connection, file: Path, table: str, number: str) -> int | None:
    """Return the number beyond which the rows of a table are on a damaged page; None if unknown.

    `number` is a column that must be the number of the row: an INTEGER PRIMARY KEY. Raises sqlite3.Error.
    """
    (size,) = database.execute("PRAGMA page_size").fetchone()
    (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    keys = [(row[1], str(row[2]).upper()) for row in database.execute(f"PRAGMA table_info({table})") if row[5]]
    if keys != [(number, "INTEGER")]:
        return None
    with file.open("rb") as pages:
        return _last_number(pages, size, root)


def _last_number(file: BinaryIO, size: int, page: int) -> int | None:
    """Return the largest row number on the way down the last pointers from a page (counted from 1).

    None if the way leads to a leaf, whose rows can be read, or to damage in a page of pointers. `size` [bytes] is that
    of a page. Damaged numbers may have any order.
    """
    largest = None
    for _ in range(_MAX_DEPTH):
        file.seek((page - 1) * size)
        data = file.read(size)
        begin = _FILE_HEAD if page == 1 else 0
        page_kind = data[begin : begin + 1]
        if page_kind == bytes([_LEAF_PAGE]):
            return None
        if page_kind != bytes([_POINTER_PAGE]):
            return largest
        # Behind the kind: the number of cells at 3, and the last pointer at 8; a pointer and a number make a cell.
        count, page = struct.unpack_from(">3xH3xI", data, begin)
        if not 0 < count <= size // 2 or page < 1:
            return None
        cells = struct.unpack_from(f">{count}H", data, begin + _PAGE_HEAD)
        # A number of variable length takes up to 9 bytes.
        numbers = [_row_number(data[cell + _POINTER_SIZE : cell + _POINTER_SIZE + 9]) for cell in cells]
        largest = max(number for number in (largest, *numbers) if number is not None)
    return None


def _row_number(data: bytes) -> int:
    """Return a number of 1 to 9 bytes, the highest bit of each of which, but the ninth, states that another follows."""
    value = 0
    for byte in data[:8]:
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value
    value = value << 8 | int.from_bytes(data[8:9])
    return value - (1 << 64) if value >> 63 else value
