"""Recovery: the readable messages of a damaged rosbag2 database, in a new one that is whole."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from palpate import LogError, OutputError, printable

from palpate_records.bags.sqlite_bag import check_tables, copy_with_journal, guard
from palpate_records.bags.sqlite_pages import last_reachable
from palpate_records.log_files import regular
from palpate_records.progress import Progress, silent
from palpate_records.temporary_folders import scratch

Row = tuple[int, int, int, bytes]  # id, topic, time-stamp [ns], message

_MESSAGES = "SELECT id, topic_id, timestamp, data FROM messages"
_MAX_NUMBER = (1 << 63) - 1  # that a message can have
_NANOSECONDS = 1e9  # in a second
# Of the format (https://www.sqlite.org/fileformat2.html, section 1.3).
_MAGIC = b"SQLite format 3\0"
_HEAD_SIZE = 32  # [bytes] that hold the size and the number of pages
_MIN_PAGE, _MAX_PAGE = 512, 65536  # [bytes], of which the latter is written as 1
# Choices.
_MAX_SIZE = 1 << 42  # [bytes] to which a file is lengthened; zeros take no place on a disk
_PAGE_HEADS = 64  # [bytes] of a page that are not part of a message
_FETCHED_MESSAGES = 64  # that are held at once
# Behind damage messages are searched by their numbers, a window of numbers at a time. A window that cannot be read is
# halved until its parts can be, or have their least width: one of 512 takes at most 1023 queries.
_WINDOW = 512  # numbers of a window
_MAX_PARTS = 512  # of a window: its least part is a single number, and of a wider window as large a share
_MAX_EMPTY_WINDOWS = 16  # in a row, before windows are doubled


def recover_bag(path: Path, out: Path, progress: Progress = silent) -> str:
    """Write the readable messages of a ``.db3`` file into a new one; return a sentence on their number.

    Raises LogError if nothing can be read, and OutputError.
    """
    if out.exists():
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten")
    regular(path)
    with scratch() as folder:
        copy = folder / path.name
        try:
            # SQLite repairs and reads a copy: the original stays as it is.
            copy_with_journal(path, copy)
            page_size = _lengthen(copy)
        except OSError as error:
            raise LogError(f"{path}: cannot be read: {error.strerror}") from error
        try:
            return _recover_copy(path, copy, out, page_size, progress)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            out.unlink(missing_ok=True)
            raise LogError(f"{path}: nothing in it can be read: {printable(str(error))}") from error
        except OSError as error:
            raise OutputError(f"{out}: cannot write: {error.strerror}") from error


def _lengthen(copy: Path) -> int | None:
    """Fill a cut file with zeros up to its size: SQLite reads nothing of a file that is shorter than it states.

    A cut page becomes zeros as a whole, lest its second half be taken for zeros. Return the size [bytes] of a page if
    something was missing, else None; raises LogError for any other file than a database.
    """
    with copy.open("r+b") as file:
        head = file.read(_HEAD_SIZE)
        if len(head) < _HEAD_SIZE or not head.startswith(_MAGIC):
            raise LogError(f"{copy.name}: is not a rosbag2 database")
        page_size, page_count = struct.unpack(">H10xI", head[16:])  # at 16 and at 28, of the format
        page_size = _MAX_PAGE if page_size == 1 else max(page_size, _MIN_PAGE)
        size = file.seek(0, 2)
        if not size < page_size * page_count <= _MAX_SIZE:
            return None
        file.truncate(size // page_size * page_size)
        file.truncate(page_size * page_count)
        return int(page_size)


def _recover_copy(path: Path, copy: Path, out: Path, page_size: int | None, progress: Progress) -> str:
    """Copy the readable tables and messages of a database into a new one; return a sentence on them.

    `page_size` [bytes] is that of a cut file, else None. Raises LogError without topics or messages.
    """
    with closing(sqlite3.connect(copy)) as old:
        guard(old)
        check_tables(old, path)
        tables = _tables(old)
        if not {"topics", "messages"} <= tables.keys():
            raise LogError(f"{path}: is not a rosbag2 database: it has no tables of topics and messages")
        topics = old.execute("SELECT id, name FROM topics").fetchall()
        with _create_database(out) as new:
            new.execute("PRAGMA synchronous = OFF")  # a recovery that is interrupted is repeated
            left_out = _copy_tables(old, new, tables)
            salvaged = _salvage(old, copy, new, page_size, progress)
            new.commit()
        if topics and "topics" in left_out:
            raise LogError(f"{path}: its table of topics cannot be read")
    if not salvaged.count:
        out.unlink()
        raise LogError(f"{path}: none of its messages can be read")
    return _recovery_sentence(salvaged, out, left_out)


def _copy_tables(old: sqlite3.Connection, new: sqlite3.Connection, tables: Mapping[str, str]) -> list[str]:
    """Copy all tables by their definitions, but only the definition of that of messages; return those left out."""
    left_out = []
    for name, definition in tables.items():
        if name == "messages":
            new.execute(definition)
        elif not _copy_table(old, new, name, definition):
            left_out.append(name)
    return left_out


@dataclass(frozen=True)
class _Salvaged:
    """The messages that could be read."""

    count: int
    first: int  # [ns] time-stamp
    last: int  # [ns]
    is_whole: bool  # True if the database has no damage


def _recovery_sentence(salvaged: _Salvaged, out: Path, left_out: Sequence[str]) -> str:
    """Return a sentence on the messages in a new database, and on the tables that it lacks."""
    seconds = (salvaged.last - salvaged.first) / _NANOSECONDS
    tables = f"; tables left out: {printable(', '.join(left_out))}" if left_out else ""
    counts = f"{salvaged.count} messages over {seconds:.3f} s are in {out}"
    if salvaged.is_whole:
        return f"the bag was whole: {counts}{tables}"
    loss = "; unreadable messages are lost, and a database has no checksums for the others"
    return f"{counts}{loss}{tables}"


def _create_database(out: Path) -> closing[sqlite3.Connection]:
    """Create a new database; raises OutputError, also for a file that exists."""
    try:
        out.open("xb").close()
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    return closing(sqlite3.connect(out))


def _tables(old: sqlite3.Connection) -> dict[str, str]:
    """Return the definitions of plain tables by name; without indices of words (FTS), and their inner tables."""
    rows = old.execute(
        "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"
    ).fetchall()
    virtual_names = [name for name, text in rows if str(text).lstrip()[:14].upper() == "CREATE VIRTUAL"]
    tables = {}
    for name, text in rows:
        is_inner = any(name.startswith(f"{virtual_name}_") for virtual_name in virtual_names)
        if text and name not in virtual_names and not is_inner:
            tables[name] = text
    return tables


def _copy_table(old: sqlite3.Connection, new: sqlite3.Connection, table: str, definition: str) -> bool:
    """Copy the stored columns of a table, without computed ones; return False if it cannot be read."""
    quoted = '"' + table.replace('"', '""') + '"'
    try:
        new.execute(definition)
        stored_columns = [row[1] for row in old.execute(f"PRAGMA table_xinfo({quoted})") if row[6] == 0]
        names = ", ".join('"' + name.replace('"', '""') + '"' for name in stored_columns)
        rows = old.execute(f"SELECT {names} FROM {quoted}")
        new.executemany(f"INSERT INTO {quoted} ({names}) VALUES ({','.join('?' * len(stored_columns))})", rows)
    except (sqlite3.Error, UnicodeError):
        return False  # messages are recovered without it
    return True


def _salvage(
    old: sqlite3.Connection, copy: Path, new: sqlite3.Connection, page_size: int | None, progress: Progress
) -> _Salvaged:
    """Copy all readable messages into a new database; return their number, their first and last time-stamp [ns].

    The copy is whole if no row was left out, and SQLite finds no damage. `page_size` [bytes] is that of a cut file,
    whose missing pages are zeros: a message of several pages that ends in zeros is left out.
    """
    count = 0
    stamps = []
    is_whole = True
    for rows in _readable_rows(old, copy):
        sound_rows = [row for row in rows if _is_sound(row, page_size)]
        is_whole &= len(sound_rows) == len(rows)
        inserted = new.executemany(
            "INSERT OR IGNORE INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", sound_rows
        )
        if sound_rows:
            row_stamps = [row[2] for row in sound_rows]
            stamps += [min(row_stamps), max(row_stamps)]
            count += inserted.rowcount  # fewer than the rows: a damaged page may give the same message again
        progress(count)
    (check,) = old.execute("PRAGMA quick_check(1)").fetchone() if is_whole else ("damaged",)
    return _Salvaged(count, min(stamps, default=0), max(stamps, default=0), is_whole=check == "ok")


def _is_sound(row: Row, page_size: int | None) -> bool:
    """Return True if a message can be whole: in a cut file, a message of several pages that ends in zeros is not."""
    _, topic, stamp, data = row
    if not (isinstance(topic, int) and isinstance(stamp, int) and isinstance(data, bytes)):
        return False
    return page_size is None or len(data) < page_size - _PAGE_HEADS or not data.endswith(b"\0")


def _readable_rows(old: sqlite3.Connection, database_path: Path) -> Iterator[list[Row]]:
    """Yield messages in the order of their numbers, around the pages that cannot be read.

    `old` is open on the file at `database_path`. Numbers may have any size, also by a changed bit: after many empty
    windows in a row these are doubled, and read again in small ones once one has a message.
    """
    begin = _extreme_number(old, "MIN", default=0)
    end = _last_number(old, database_path)
    width = _WINDOW
    empty_windows = 0
    while begin <= end:
        if width == _WINDOW:
            begin = yield from _rows_from(old, begin)
            if begin > end:
                return
        # Behind damage, a window of `width` numbers at a time: parts that cannot be read are halved.
        rows = _rows_between(old, begin, begin + width, min_width=width // _MAX_PARTS)
        # Messages in a wide window: the same numbers again, in small windows.
        if rows and width > _WINDOW:
            width = _WINDOW
            empty_windows = 0
            continue
        yield rows
        begin += width
        empty_windows = 0 if rows else empty_windows + 1
        width = 2 * width if empty_windows >= _MAX_EMPTY_WINDOWS else _WINDOW


def _rows_from(old: sqlite3.Connection, begin: int) -> Generator[list[Row], None, int]:
    """Yield messages from a number on, up to damage; return the number behind them, or behind all."""
    try:
        cursor = old.execute(f"{_MESSAGES} WHERE id >= ? ORDER BY id", (begin,))
        while rows := cursor.fetchmany(_FETCHED_MESSAGES):
            yield rows
            begin = max(begin, *(row[0] + 1 for row in rows))
    except sqlite3.Error:
        return begin
    return _MAX_NUMBER + 1


def _extreme_number(old: sqlite3.Connection, function: str, default: int) -> int:
    """Return the MIN or MAX number of a message; the default if it cannot be read."""
    try:
        number = old.execute(f"SELECT {function}(id) FROM messages").fetchone()[0]
    except sqlite3.Error:
        return default
    return number if isinstance(number, int) else default


def _last_number(old: sqlite3.Connection, database_path: Path) -> int:
    """Return the largest number that a readable message may have."""
    end = _extreme_number(old, "MAX", default=_MAX_NUMBER)
    if end < _MAX_NUMBER:
        return end
    try:
        last = last_reachable(old, database_path, "messages", "id")
    except (sqlite3.Error, OSError, struct.error):
        return end
    return end if last is None else last


def _rows_between(old: sqlite3.Connection, begin: int, end: int, min_width: int) -> list[Row]:
    """Return the readable messages of [begin, end); a part that cannot be read is halved, down to a least width."""
    last = min(end - 1, _MAX_NUMBER)
    # Behind the last number of a range SQLite looks at the next message, whose page may be damaged; behind one it looks
    # for by its number it does not.
    is_in_part = "id = ?" if begin == last else "id >= ? AND id <= ?"
    numbers = (begin,) if begin == last else (begin, last)
    try:
        return old.execute(f"{_MESSAGES} WHERE {is_in_part}", numbers).fetchall()
    except sqlite3.Error:
        if end - begin <= min_width:
            return []
        middle = (begin + end) // 2
        return _rows_between(old, begin, middle, min_width) + _rows_between(old, middle, end, min_width)
