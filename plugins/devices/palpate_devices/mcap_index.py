"""The index of a log that is being written: on disk, for a run of days has a million chunks."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO, Any

_LENGTH = struct.Struct("<I")  # [bytes] of a record, in front of it


class _IndexRecord:
    """A record of the index that is in bytes already."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def write(self, stream: Any) -> None:
        """Append it to a record builder."""
        stream.write(self._data)


class Index:
    """Records of the index in a file; to the library's writer, a list."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def append(self, record: Any) -> None:
        """Append a record, in bytes, to the file."""
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        record.write(builder)
        data: bytes = builder.end()  # type: ignore[no-untyped-call]
        self._file.write(_LENGTH.pack(len(data)) + data)

    @property
    def size(self) -> int:
        """The size [bytes]."""
        return self._file.tell()

    def shorten(self, size: int) -> None:
        """Drop what came after a size [bytes]; raises OSError."""
        self._file.seek(size)
        self._file.truncate()

    def __iter__(self) -> Iterator[_IndexRecord]:
        self._file.seek(0)
        while head := self._file.read(_LENGTH.size):
            yield _IndexRecord(self._file.read(_LENGTH.unpack(head)[0]))


def keep_index_in(writer: Any, file: IO[bytes]) -> None:
    """Let a writer of the library keep its chunk index in a file instead of in memory, 1 MB in five minutes.

    The library has no such setting. Where a version of it names its list otherwise, the index stays in memory.
    """
    if isinstance(getattr(writer, "_Writer__chunk_indices", None), list):
        writer._Writer__chunk_indices = Index(file)
