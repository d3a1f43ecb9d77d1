"""A rosbag2 ``.db3`` file as a container of topics."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Iterator, Mapping, Set
from contextlib import closing, contextmanager
from functools import cached_property
from pathlib import Path
from typing import IO

import numpy as np
from palpate import LogError, printable

from palpate_records.decompression import largest, unpack
from palpate_records.log_files import regular
from palpate_records.messages.topic_kinds import named_by_kind
from palpate_records.messages.topics import Messages, Topic
from palpate_records.temporary_folders import scratch

# Choices.
_BLOCK_MESSAGES = 4000  # that are read at once
_BLOCK_SIZE = 1 << 25  # [bytes] of one topic's messages that are held at once
_MAX_VALUE = 1 << 28  # [bytes] of one value
_COMPRESSIONS = {".gz": "gzip", ".zstd": "zstd", ".zst": "zstd"}
# Of the format (https://www.sqlite.org/fileformat2.html, section 1.3).
_MAGIC = b"SQLite format 3\0"
_HEAD_SIZE = 100  # [bytes]
_MAX_PAGE = 65536  # [bytes], which are written as 1


class SqliteBag:
    """One database file; a compressed one is unpacked into a temporary folder while it is read."""

    def __init__(self, path: Path, packed_messages: bool = False) -> None:
        self.path = path
        self._has_packed_messages = packed_messages  # each message is compressed by itself
        regular(path)

    @property
    def trouble(self) -> str | None:
        """None: a database is whole, or cannot be opened."""
        return None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """Topics by name."""
        return {topic.name: topic for topic in self._topics.values()}

    @cached_property
    def _topics(self) -> Mapping[int, Topic]:
        """Topics by their numbers in the database."""
        with self._open() as database:
            columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
            if not {"name", "type", "serialization_format"} <= columns:
                raise LogError(f"{self.path}: is not a rosbag2 database: it has no table of topics")
            texts = dict(self._definitions(database))
            rows = database.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id").fetchall()
        undefined = "ros2msg", b""
        topics = {
            identity: Topic(name, type_name, encoding, *texts.get(type_name, undefined))
            for identity, name, type_name, encoding in rows
        }
        return named_by_kind(topics)

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]."""
        return self._span

    @cached_property
    def _span(self) -> tuple[int, int] | None:
        """The value of `span`, computed once."""
        with self._open() as database:
            first, last = database.execute("SELECT MIN(timestamp), MAX(timestamp) FROM messages").fetchone()
            if first is None:
                return None
            if not (isinstance(first, int) and isinstance(last, int)):
                raise sqlite3.DatabaseError("a message has no time-stamp")
        return first, last

    @staticmethod
    def _definitions(database: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, bytes]]]:
        """Yield the definitions by type, which rosbag2 writes since Iron."""
        if not database.execute("PRAGMA table_info(message_definitions)").fetchall():
            return
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        for type_name, encoding, text in database.execute(query):
            if encoding in ("ros2msg", "ros2idl"):
                yield type_name, (encoding, text.encode() if isinstance(text, str) else bytes(text))

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Yield messages of the `wanted` topics in the order of their time-stamps, within [begin, end) [ns]."""
        with self._open() as database:
            names = {identity: topic.name for identity, topic in self._topics.items()}
            identities = [identity for identity, name in names.items() if name in wanted]
            query = (
                f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({','.join('?' * len(identities))}) "
                "AND timestamp >= ? AND timestamp < ? ORDER BY timestamp, id"
            )
            # Without a limit: the least and the greatest integer of SQLite.
            first = -(1 << 63) if begin is None else begin
            last = (1 << 63) - 1 if end is None else end
            cursor = database.execute(query, (*identities, first, last))
            while rows := _next_rows(cursor):
                yield from self._messages_by_topic(rows, names)

    def _messages_by_topic(
        self, rows: list[tuple[int, int, bytes]], names: Mapping[int, str]
    ) -> Iterator[tuple[str, Messages]]:
        """Yield rows of topic, stamp [ns] and message as blocks of one topic each."""
        for identity in dict.fromkeys(row[0] for row in rows):
            topic_rows = [row for row in rows if row[0] == identity]
            for plain_rows in unpacked_rows(topic_rows) if self._has_packed_messages else (topic_rows,):
                stamps = np.array([row[1] for row in plain_rows], np.int64)
                yield names[identity], Messages.joined([row[2] for row in plain_rows], stamps, stamps)

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """Open the database; whatever is wrong with it raises LogError, also while it is read."""
        try:
            with scratch() as folder:
                path = self._plain_file(folder)
                with path.open("rb") as file:
                    if file.read(len(_MAGIC)) != _MAGIC:
                        raise LogError(f"{self.path}: is not a rosbag2 database")
                    if (missing_size := _missing_size(file)) and not journals(self.path):
                        raise sqlite3.DatabaseError(f"its last {missing_size} bytes are missing")
                mode = "mode=ro&immutable=1" if path == self.path else "mode=rw"
                with closing(_connect(path, mode)) as database:
                    check_tables(database, self.path)
                    yield database
        except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter from a name within the database
            raise LogError(f"{self.path}: the database is damaged: {printable(str(error))}") from error
        except (OSError, EOFError) as error:
            raise LogError(f"{self.path}: cannot be read: {error}") from error

    def _plain_file(self, folder: Path) -> Path:
        """Return the database itself, or a copy in the folder if it is compressed or has a journal."""
        compression = _COMPRESSIONS.get(self.path.suffix.lower())
        if compression is None and not journals(self.path):
            return self.path
        target = folder / "bag.db3"
        if compression is None:
            copy_with_journal(self.path, target)
        else:
            unpack(self.path, target, compression, _MAGIC)
        return target


def _missing_size(file: IO[bytes]) -> int:
    """Return the bytes that a database lacks of the size that it states: SQLite would read zeros in their place."""
    file.seek(0)
    head = file.read(_HEAD_SIZE)
    is_outdated = head[24:28] != head[92:96]  # the number of pages is that of another change
    if len(head) < _HEAD_SIZE or is_outdated:
        return 0
    page_size, page_count = struct.unpack_from(">H10xI", head, 16)
    stated_size = (_MAX_PAGE if page_size == 1 else int(page_size)) * int(page_count)
    return max(stated_size - file.seek(0, 2), 0)


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open a database that may come from anybody."""
    database = sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)
    guard(database)
    return database


def guard(database: sqlite3.Connection) -> None:
    """Forbid functions in the schema and long values to a database that may come from anybody; accept any names."""
    database.text_factory = lambda raw: raw.decode(errors="replace")
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MAX_VALUE)
    database.execute("PRAGMA trusted_schema = OFF")


def check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Raise LogError for a view or virtual table with the name of a bag's table: it may never end."""
    for name, object_type, text in database.execute("SELECT name, type, sql FROM sqlite_master"):
        if str(name).lower() not in ("topics", "messages", "message_definitions"):
            continue
        is_virtual = str(text).lstrip()[:15].upper().startswith("CREATE VIRTUAL")
        if is_virtual or object_type not in ("table", "index"):
            raise LogError(f"{path}: is not a rosbag2 database: {name} is not a table in it")


def journals(path: Path) -> list[Path]:
    """Return the files next to a database with messages that a running or killed recorder has not yet put into it."""
    files = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    return [file for file in files if file.is_file() and file.stat().st_size]


def copy_with_journal(path: Path, target: Path) -> None:
    """Copy a database with the files next to it, so that SQLite can complete the copy and leave the original alone."""
    shutil.copyfile(path, target)
    for file in journals(path):
        shutil.copyfile(file, target.with_name(target.name + file.name.removeprefix(path.name)))


def _next_rows(cursor: sqlite3.Cursor) -> list[tuple[int, int, bytes]]:
    """Return the next messages: a few thousand, or fewer large ones; raises sqlite3.DatabaseError."""
    rows: list[tuple[int, int, bytes]] = []
    size = 0
    while len(rows) < _BLOCK_MESSAGES and size < _BLOCK_SIZE:
        row = cursor.fetchone()
        if row is None:
            break
        if not (isinstance(row[2], bytes) and isinstance(row[1], int)):
            raise sqlite3.DatabaseError("a message has no time-stamp, or no bytes")
        rows.append(row)
        size += len(row[2])
    return rows


def unpacked_rows(rows: list[tuple[int, int, bytes]]) -> Iterator[list[tuple[int, int, bytes]]]:
    """Yield messages that were compressed one by one, as many at once as the memory of a block holds."""
    plain_rows: list[tuple[int, int, bytes]] = []
    size = 0
    for identity, stamp, packed in rows:
        message = _unpack_message(packed)
        plain_rows.append((identity, stamp, message))
        size += len(message)
        if size >= _BLOCK_SIZE:
            yield plain_rows
            plain_rows = []
            size = 0
    if plain_rows:
        yield plain_rows


def _unpack_message(packed: bytes) -> bytes:
    """Return a decompressed message; raises sqlite3.DatabaseError for damage, and for one that is too large."""
    import zstandard

    try:
        claimed_size = zstandard.get_frame_parameters(packed).content_size
        max_size = min(largest(len(packed)), _MAX_VALUE)
        # The library would allocate the claimed size.
        if claimed_size != zstandard.CONTENTSIZE_UNKNOWN and claimed_size > max_size:
            raise sqlite3.DatabaseError(f"a compressed message of {len(packed)} bytes claims to become {claimed_size}")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=max_size)
    except zstandard.ZstdError as error:
        raise sqlite3.DatabaseError(f"a compressed message: {error}") from error
