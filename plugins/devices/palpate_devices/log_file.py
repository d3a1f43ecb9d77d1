"""The file of a log that is being written: where the disk is full, it ends with its last whole chunk."""

from __future__ import annotations

import copy
import errno
import os
import struct
from contextlib import suppress
from typing import Any

from palpate_devices.mcap_index import Index

_MOST = 1 << 20  # [bytes] that wait in memory
_MAGIC = b"\x89MCAP0\r\n"
_DATA_END, _FOOTER = struct.pack("<BQI", 0x0F, 4, 0), struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)
_NOTED = ("statistics", "chunk_indices", "attachment_indexes", "metadata_indexes")  # by the library's writer


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
        if len(self._waiting) > _MOST:
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
        size = os.fstat(self._descriptor).st_size
        self._is_truncated |= size < self._written
        if self._is_truncated:
            self._waiting.clear()
            text = f"another program has truncated it: {size} of {self._written} bytes are left of what was recorded"
            raise OSError(errno.EIO, text)

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def mark(self) -> None:
        """Up to here the file is whole."""
        self._whole = self.tell()

    def unmarked(self) -> int:
        """Return the bytes since the latest mark."""
        return self.tell() - self._whole

    def cut(self) -> None:
        """Back to the latest mark; raises OSError."""
        self._demand_whole()
        self._waiting.clear()
        os.ftruncate(self._descriptor, self._whole)
        self._written = os.lseek(self._descriptor, self._whole, os.SEEK_SET)


class Bookmark:
    """What the library's writer has noted of a log up to the latest mark of its file."""

    def __init__(self, writer: Any, file: LogFile) -> None:
        self._writer, self._file = writer, file
        self._noted: dict[str, Any] = {}
        self.set()

    def set(self) -> None:
        """The log is whole up to here, and with the system; raises OSError."""
        self._file.flush()
        self._file.mark()
        noted = {name: getattr(self._writer, f"_Writer__{name}", None) for name in _NOTED}
        self._noted = {name: x.size if isinstance(x, Index) else _length_or_copy(x) for name, x in noted.items()}

    def close(self) -> None:
        """End the log at its latest mark, with the library's index where there is room for it; raises OSError."""
        self._file.cut()
        with suppress(OSError, AttributeError, TypeError):  # a full disk; a library that names its parts otherwise
            self._take_back()
            self._writer.finish()
            self._file.flush()
            return
        self._file.cut()
        self._file.write(_DATA_END + _FOOTER + _MAGIC)
        self._file.flush()

    def _take_back(self) -> None:
        writer = self._writer
        for name, before in self._noted.items():
            if name == "statistics":
                writer._Writer__statistics = copy.deepcopy(before)
            elif isinstance(entries := getattr(writer, f"_Writer__{name}"), Index):
                entries.shorten(before)
            else:
                del entries[before:]
        writer._Writer__record_builder.end()
        writer._Writer__summary_offsets.clear()
        writer._Writer__chunk_builder.reset()


def _length_or_copy(noted: Any) -> Any:
    return len(noted) if isinstance(noted, list) else copy.deepcopy(noted)
