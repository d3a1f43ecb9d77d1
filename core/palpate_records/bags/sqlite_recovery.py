"""Recovery: what can be read of a damaged rosbag2 database, in a new one that is whole."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path

from palpate import LogError, OutputError, printable

from palpate_records.bags.sqlite_bag import check_tables, copy_with_journal, guard
from palpate_records.bags.sqlite_pages import last_reachable
from palpate_records.log_files import regular
from palpate_records.progress import Progress, silent
from palpate_records.temporary_folders import scratch

Row = tuple[int, int, int, bytes]  # id, topic, time-stamp [ns], message

_LARGEST = 1 << 42  # [bytes]; zeros take no place
_HEADS = 64  # [bytes] of a page that are not part of a message
_MESSAGES = "SELECT id, topic_id, timestamp, data FROM messages"
_LAST = (1 << 63) - 1  # the largest number that a message can have
_TOGETHER = 64  # messages that are held at once
_WINDOW = 512  # numbers of messages that are asked for at once where something cannot be read
_COARSE = 64  # of them, where there have been none for a while
_PATIENCE = 16  # windows in a row that give nothing, before ever more is passed over at once


def recover_bag(path: Path, out: Path, progress: Progress = silent) -> str:
    """Write what can be read of a ``.db3`` file into a new one, and report how much that is."""
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    regular(path)
    with scratch() as folder:
        copy = folder / path.name
        try:
            copy_with_journal(path, copy)
            page = _lengthen(copy)
        except OSError as error:
            raise LogError(f"{path}: cannot be read: {error.strerror}") from error
        try:
            return _recovered(path, copy, out, page, progress)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            out.unlink(missing_ok=True)
            raise LogError(f"{path}: nothing in it can be read: {printable(str(error))}") from error
        except OSError as error:
            raise OutputError(f"{out}: cannot write: {error.strerror}") from error


def _lengthen(copy: Path) -> int | None:
    """Fill a file that is cut with zeros up to its size: SQLite reads nothing of one that is shorter than it states.

    A page that is not all there goes as a whole, lest its second half be taken for zeros. Returns the size of a page
    where something was missing.
    """
    with copy.open("r+b") as file:
        head = file.read(32)
        if len(head) < 32 or not head.startswith(b"SQLite format 3\0"):
            raise LogError(f"{copy.name}: is not a rosbag2 database")
        size, pages = struct.unpack(">H10xI", head[16:])
        size = 65536 if size == 1 else max(size, 512)
        there = file.seek(0, 2)
        if not there < size * pages <= _LARGEST:
            return None
        file.truncate(there // size * size)
        file.truncate(size * pages)
        return int(size)


def _recovered(path: Path, copy: Path, out: Path, page: int | None, progress: Progress) -> str:
    with closing(sqlite3.connect(copy)) as old:
        guard(old)
        check_tables(old, path)
        tables = _tables(old)
        if not {"topics", "messages"} <= tables.keys():
            raise LogError(f"{path}: is not a rosbag2 database: it has no tables of topics and messages")
        topics = old.execute("SELECT id, name FROM topics").fetchall()
        left_out = []
        with _created(out) as new:
            new.execute("PRAGMA synchronous = OFF")  # a recovery that is interrupted is repeated
            for name, definition in tables.items():
                if name == "messages":
                    new.execute(definition)
                elif not _taken_over(old, new, name, definition):
                    left_out.append(name)
            count, first, last, whole = _salvage(old, copy, new, page, progress)
            new.commit()
        if topics and "topics" in left_out:
            raise LogError(f"{path}: its table of topics cannot be read")
    if not count:
        out.unlink()
        raise LogError(f"{path}: none of its messages can be read")
    said = "the bag was whole: " if whole else ""
    lost = "" if whole else "; unreadable messages are lost, and a database has no checksums for the others"
    beside = f"; tables left out: {printable(', '.join(left_out))}" if left_out else ""
    return f"{said}{count} messages over {(last - first) / 1e9:.3f} s are in {out}{lost}{beside}"


def _created(out: Path) -> closing[sqlite3.Connection]:
    try:
        out.open("xb").close()
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    return closing(sqlite3.connect(out))


def _tables(old: sqlite3.Connection) -> dict[str, str]:
    """Plain tables and how they are made; an index of words (FTS) has tables of its own, and is left behind."""
    rows = old.execute(
        "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"
    ).fetchall()
    virtual = [name for name, text in rows if str(text).lstrip()[:14].upper() == "CREATE VIRTUAL"]
    return {
        name: text
        for name, text in rows
        if text and name not in virtual and not any(name.startswith(f"{other}_") for other in virtual)
    }


def _taken_over(old: sqlite3.Connection, new: sqlite3.Connection, table: str, definition: str) -> bool:
    """Copy a table; whether that was possible, as far as its columns are stored and not computed."""
    quoted = '"' + table.replace('"', '""') + '"'
    try:
        new.execute(definition)
        stored = [row[1] for row in old.execute(f"PRAGMA table_xinfo({quoted})") if row[6] == 0]
        names = ", ".join('"' + name.replace('"', '""') + '"' for name in stored)
        rows = old.execute(f"SELECT {names} FROM {quoted}")
        new.executemany(f"INSERT INTO {quoted} ({names}) VALUES ({','.join('?' * len(stored))})", rows)
    except (sqlite3.Error, UnicodeError):
        return False  # it says nothing of the messages, and is not worth losing them for
    return True


def _salvage(
    old: sqlite3.Connection, copy: Path, new: sqlite3.Connection, page: int | None, progress: Progress
) -> tuple[int, int, int, bool]:
    """Messages that came over, their first and last time-stamps [ns], and whether nothing was wrong."""
    count, stamps, whole = 0, [], True
    for rows in _everything(old, copy):
        good = [row for row in rows if _sound(row, page)]
        whole &= len(good) == len(rows)
        done = new.executemany(
            "INSERT OR IGNORE INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", good
        )
        stamps += [pick(row[2] for row in good) for pick in (min, max)] if good else []
        count += done.rowcount if good else 0  # a damaged page may give the same again
        progress(count)
    (check,) = old.execute("PRAGMA quick_check(1)").fetchone() if whole else ("damaged",)
    return count, min(stamps, default=0), max(stamps, default=0), check == "ok"


def _sound(row: Row, page: int | None) -> bool:
    """Return True if a message can be what it was: one of several pages whose last is missing ends in zeros."""
    _, topic, stamp, data = row
    if not (isinstance(topic, int) and isinstance(stamp, int) and isinstance(data, bytes)):
        return False
    return page is None or len(data) < page - _HEADS or not data.endswith(b"\0")


def _everything(old: sqlite3.Connection, copy: Path) -> Iterator[list[Row]]:
    """Messages in the order of their numbers, around the pages that cannot be read.

    Numbers may be anything, also where a bit of one has changed: where many in a row give nothing, ever more of them
    are passed over at once, and gone through again once there is something.
    """
    begin, end = _bound(old, "MIN", 0), _end(old, copy)
    width, silent = _WINDOW, 0
    while begin <= end:
        if width == _WINDOW:
            begin = yield from _scanned(old, begin)
            if begin > end:
                return
        rows = _between(old, begin, begin + width, max(width // _WINDOW, _COARSE if silent else 1))
        if rows and width > _WINDOW:
            width, silent = _WINDOW, 0
            continue
        yield rows
        begin += width
        silent = 0 if rows else silent + 1
        width = 2 * width if silent >= _PATIENCE else _WINDOW


def _scanned(old: sqlite3.Connection, begin: int) -> Generator[list[Row], None, int]:
    """Messages from a number on as far as they can be read in one go; the number behind them, or behind all."""
    try:
        found = old.execute(f"{_MESSAGES} WHERE id >= ? ORDER BY id", (begin,))
        while rows := found.fetchmany(_TOGETHER):
            yield rows
            begin = max(begin, *(row[0] + 1 for row in rows))
    except sqlite3.Error:
        return begin
    return _LAST + 1


def _bound(old: sqlite3.Connection, which: str, otherwise: int) -> int:
    """Return the smallest or largest number of a message, where it can be determined."""
    try:
        found = old.execute(f"SELECT {which}(id) FROM messages").fetchone()[0]
    except sqlite3.Error:
        return otherwise
    return found if isinstance(found, int) else otherwise


def _end(old: sqlite3.Connection, copy: Path) -> int:
    """Return the largest number that a message which can be read may have."""
    end = _bound(old, "MAX", _LAST)
    if end < _LAST:
        return end
    try:
        last = last_reachable(old, copy, "messages", "id")
    except (sqlite3.Error, OSError, struct.error):
        return end
    return end if last is None else last


def _between(old: sqlite3.Connection, begin: int, end: int, least: int) -> list[Row]:
    """Return the messages of [begin, end) that can be read; halves of what cannot be read as a whole are tried."""
    try:
        return old.execute(f"{_MESSAGES} WHERE id >= ? AND id <= ?", (begin, min(end - 1, _LAST))).fetchall()
    except sqlite3.Error:
        if end - begin <= least:
            return []
        middle = (begin + end) // 2
        return _between(old, begin, middle, least) + _between(old, middle, end, least)
