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

_BLOCK = 4000  # messages read at once
_BYTES = 1 << 25  # [bytes] of one topic's messages held at once
_MAGIC = b"SQLite format 3\0"
_LONGEST = 1 << 28  # [bytes] of one value
_COMPRESSED = {".gz": "gzip", ".zstd": "zstd", ".zst": "zstd"}


class SqliteBag:
    """One database file; a compressed one is unpacked into the folder of temporary files while it is read."""

    def __init__(self, path: Path, packed_messages: bool = False) -> None:
        self.path = path
        self._packed = packed_messages  # each message is compressed by itself
        regular(path)

    @property
    def trouble(self) -> str | None:
        """A database is whole, or cannot be opened."""
        return None

    @property
    def topics(self) -> Mapping[str, Topic]:
        """By name."""
        return {topic.name: topic for topic in self._topics.values()}

    @cached_property
    def _topics(self) -> Mapping[int, Topic]:
        with self._open() as database:
            columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
            if not {"name", "type", "serialization_format"} <= columns:
                raise LogError(f"{self.path}: is not a rosbag2 database: it has no table of topics")
            texts = dict(self._definitions(database))
            rows = database.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id").fetchall()
        undefined = "ros2msg", b""
        topics = {
            identity: Topic(name, kind, encoding, *texts.get(kind, undefined))
            for identity, name, kind, encoding in rows
        }
        return named_by_kind(topics)

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time [ns]."""
        return self._span

    @cached_property
    def _span(self) -> tuple[int, int] | None:
        with self._open() as database:
            first, last = database.execute("SELECT MIN(timestamp), MAX(timestamp) FROM messages").fetchone()
            if first is None:
                return None
            if not (isinstance(first, int) and isinstance(last, int)):
                raise sqlite3.DatabaseError("a message has no time-stamp")
        return first, last

    @staticmethod
    def _definitions(database: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, bytes]]]:
        """Definitions by type, which rosbag2 writes since Iron."""
        if not database.execute("PRAGMA table_info(message_definitions)").fetchall():
            return
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        for kind, encoding, text in database.execute(query):
            if encoding in ("ros2msg", "ros2idl"):
                yield kind, (encoding, text.encode() if isinstance(text, str) else bytes(text))

    def blocks(
        self, wanted: Set[str], begin: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, Messages]]:
        """Messages of the requested topics in the order of their time-stamps, within [begin, end) [ns]."""
        with self._open() as database:
            named = {identity: topic.name for identity, topic in self._topics.items()}
            identities = [identity for identity, name in named.items() if name in wanted]
            query = (
                f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({','.join('?' * len(identities))}) "
                "AND timestamp >= ? AND timestamp < ? ORDER BY timestamp, id"
            )
            window = (-(1 << 63) if begin is None else begin, (1 << 63) - 1 if end is None else end)
            rows = database.execute(query, (*identities, *window))
            while block := _some(rows):
                yield from self._grouped(block, named)

    def _grouped(self, block: list[tuple[int, int, bytes]], named: Mapping[int, str]) -> Iterator[tuple[str, Messages]]:
        for identity in dict.fromkeys(row[0] for row in block):
            rows = [row for row in block if row[0] == identity]
            for some in unpacked_rows(rows) if self._packed else (rows,):
                stamps = np.array([row[1] for row in some], np.int64)
                yield named[identity], Messages.joined([row[2] for row in some], stamps, stamps)

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            with scratch() as folder:
                path = self._plain(folder)
                with path.open("rb") as file:
                    if file.read(len(_MAGIC)) != _MAGIC:
                        raise LogError(f"{self.path}: is not a rosbag2 database")
                    if (missing := _missing(file)) and not journals(self.path):
                        raise sqlite3.DatabaseError(f"its last {missing} bytes are missing")
                with closing(_connected(path, "mode=ro&immutable=1" if path == self.path else "mode=rw")) as database:
                    check_tables(database, self.path)
                    yield database
        except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter from a name within the database
            raise LogError(f"{self.path}: the database is damaged: {printable(str(error))}") from error
        except (OSError, EOFError) as error:
            raise LogError(f"{self.path}: cannot be read: {error}") from error

    def _plain(self, folder: Path) -> Path:
        kind = _COMPRESSED.get(self.path.suffix.lower())
        target = folder / "bag.db3"
        if kind is None and not journals(self.path):
            return self.path
        if kind is None:
            copy_with_journal(self.path, target)
        else:
            unpack(self.path, target, kind, _MAGIC)
        return target


def _missing(file: IO[bytes]) -> int:
    """Return how many bytes a database is shorter than it states [bytes]: SQLite takes what a cut page lacks for
    zeros."""
    file.seek(0)
    head = file.read(100)
    if len(head) < 100 or head[24:28] != head[92:96]:  # the number of pages is out of date
        return 0
    page, pages = struct.unpack_from(">H10xI", head, 16)
    return max((65536 if page == 1 else int(page)) * int(pages) - file.seek(0, 2), 0)


def _connected(path: Path, mode: str) -> sqlite3.Connection:
    """Return a database that may come from anybody: names of any bytes, no long values, no functions out of its
    schema."""
    database = sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)
    guard(database)
    return database


def guard(database: sqlite3.Connection) -> None:
    """Let nothing in a third-party database run, or take more memory than a message may."""
    database.text_factory = lambda raw: raw.decode(errors="replace")
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
    database.execute("PRAGMA trusted_schema = OFF")


def check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Refuse views and virtual tables under the names of a bag's tables: reading one may never end."""
    for name, kind, text in database.execute("SELECT name, type, sql FROM sqlite_master"):
        ours = str(name).lower() in ("topics", "messages", "message_definitions")
        if ours and (kind not in ("table", "index") or str(text).lstrip()[:15].upper().startswith("CREATE VIRTUAL")):
            raise LogError(f"{path}: is not a rosbag2 database: {name} is not a table in it")


def journals(path: Path) -> list[Path]:
    """What a recorder that is at work, or was killed, leaves next to a database: messages that are not yet in it."""
    beside = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    return [file for file in beside if file.is_file() and file.stat().st_size]


def copy_with_journal(path: Path, target: Path) -> None:
    """Copy a database with the files next to it, so that SQLite can complete the copy and leave the original alone."""
    shutil.copyfile(path, target)
    for file in journals(path):
        shutil.copyfile(file, target.with_name(target.name + file.name.removeprefix(path.name)))


def _some(rows: sqlite3.Cursor) -> list[tuple[int, int, bytes]]:
    """Return the next messages: a few thousand, or fewer large ones."""
    block: list[tuple[int, int, bytes]] = []
    size = 0
    while len(block) < _BLOCK and size < _BYTES:
        row = rows.fetchone()
        if row is None:
            break
        if not (isinstance(row[2], bytes) and isinstance(row[1], int)):
            raise sqlite3.DatabaseError("a message has no time-stamp, or no bytes")
        block.append(row)
        size += len(row[2])
    return block


def unpacked_rows(rows: list[tuple[int, int, bytes]]) -> Iterator[list[tuple[int, int, bytes]]]:
    """Messages that were compressed one by one, no more at once than are held of plain ones."""
    some: list[tuple[int, int, bytes]] = []
    size = 0
    for identity, stamp, packed in rows:
        some.append((identity, stamp, _message(packed)))
        size += len(some[-1][2])
        if size >= _BYTES:
            yield some
            some, size = [], 0
    if some:
        yield some


def _message(packed: bytes) -> bytes:
    import zstandard

    try:
        size = zstandard.get_frame_parameters(packed).content_size
        most = min(largest(len(packed)), _LONGEST)
        if size != zstandard.CONTENTSIZE_UNKNOWN and size > most:  # else the library trusts it
            raise sqlite3.DatabaseError(f"a compressed message of {len(packed)} bytes claims to become {size}")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=most)
    except zstandard.ZstdError as error:
        raise sqlite3.DatabaseError(f"a compressed message: {error}") from error
