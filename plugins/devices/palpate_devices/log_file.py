"""The file of a log that is being written: where the disk is full, it ends with its last whole chunk."""

from __future__ import annotations

import copy
import errno
import os
import struct
from contextlib import suppress
from typing import Any

from palpate_devices.mcap_index import Index

_MAX_WAITING = 1 << 20  # [bytes], a choice: so many are held in memory before they go to the system
# The end of a file by the specification of MCAP: magic bytes, and records of an opcode, a length and numbers that are 0
# where checksum and summary are missing.
_MAGIC = b"\x89MCAP0\r\n"
_DATA_END = struct.pack("<BQI", 0x0F, 4, 0)  # opcode, length, checksum
_FOOTER = struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)  # opcode, length, start of summary and of its offsets, checksum
_MARKED_PARTS = ("statistics", "chunk_indices", "attachment_indexes", "metadata_indexes")  # of the library's writer


class LogFile:
    """A binary file to write, which can be cut back to where it was last known to be whole.

    One that another program has truncated is written no further: what follows would leave a hole in it.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting = bytearray()
        self._written = self._whole = 0  # [bytes]
        self._is_truncated = False

    def write(self, data: Any) -> int:
        """Append bytes; raises OSError."""
        self._waiting += data
        if len(self._waiting) > _MAX_WAITING:
            self.flush()
        return len(data)

    def tell(self) -> int:
        """Return the place [bytes] of what is written next."""
        return self._written + len(self._waiting)

    def flush(self) -> None:
        """Hand everything to the system; raises OSError, also where another program has truncated the file."""
        self._demand_whole()
        while self._waiting:
            count = os.write(self._descriptor, self._waiting)
            self._written += count
            del self._waiting[:count]

    def _demand_whole(self) -> None:
        """Raise OSError where another program has truncated the file, now or before."""
        size = os.fstat(self._descriptor).st_size
        self._is_truncated |= size < self._written
        if self._is_truncated:
            self._waiting.clear()
            text = f"another program has truncated it: {size} of {self._written} bytes are left of what was recorded"
            raise OSError(errno.EIO, text)

    def fileno(self) -> int:
        """Return its descriptor."""
        return self._descriptor

    def mark(self) -> None:
        """Note that the file is whole up to here."""
        self._whole = self.tell()

    def unmarked(self) -> int:
        """Return the bytes since the latest mark."""
        return self.tell() - self._whole

    def cut(self) -> None:
        """Cut the file back to the latest mark; raises OSError."""
        self._demand_whole()
        self._waiting.clear()
        os.ftruncate(self._descriptor, self._whole)
        self._written = os.lseek(self._descriptor, self._whole, os.SEEK_SET)


class Bookmark:
    """State of the library's writer at the latest mark of its file: copies, and lengths of lists that only grow."""

    def __init__(self, writer: Any, file: LogFile) -> None:
        self._writer, self._file = writer, file
        self._state: dict[str, Any] = {}
        self.set()

    def set(self) -> None:
        """Hand everything to the system, and note that the log is whole up to here; raises OSError."""
        self._file.flush()
        self._file.mark()
        state = {}
        for name in _MARKED_PARTS:
            state[name] = _size_or_copy(getattr(self._writer, f"_Writer__{name}", None))
        self._state = state

    def close(self) -> None:
        """End the log at its latest mark, with the library's index where there is room for it; raises OSError."""
        self._file.cut()
        with suppress(OSError, AttributeError, TypeError):  # a full disk; a library that names its parts otherwise
            self._restore()
            self._writer.finish()
            self._file.flush()
            return
        # Without an index: the least that ends a file.
        self._file.cut()
        self._file.write(_DATA_END + _FOOTER + _MAGIC)
        self._file.flush()

    def _restore(self) -> None:
        """Set the library's writer back to its state at the latest mark."""
        writer = self._writer
        for name, state in self._state.items():
            if name == "statistics":
                writer._Writer__statistics = copy.deepcopy(state)
            elif isinstance(entries := getattr(writer, f"_Writer__{name}"), Index):
                entries.shorten(state)
            else:
                del entries[state:]
        # The chunk that was not finished is dropped.
        writer._Writer__record_builder.end()
        writer._Writer__summary_offsets.clear()
        writer._Writer__chunk_builder.reset()


def _size_or_copy(part: Any) -> Any:
    """Return the size of a list that only grows, on disk [bytes] or in memory, and a copy of anything else."""
    if isinstance(part, Index):
        return part.size
    return len(part) if isinstance(part, list) else copy.deepcopy(part)
