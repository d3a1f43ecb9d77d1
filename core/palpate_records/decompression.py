"""Compressed files: opened by what they begin with, and never unpacked beyond what is plausible and fits."""

from __future__ import annotations

import gzip
import shutil
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

_BLOCK = 1 << 18  # [bytes]
_PIECE = 1 << 11  # [bytes] of zstd at once: what 2 KiB can become at most is 64 MiB
_RATIO = 200  # how much larger than its file a bag may become; real ones: 2 to 20
_FREE = 1 << 26  # [bytes] that are small enough whatever the ratio
_SPARE = 1 << 28  # [bytes] of a disk that are left to others
DAMAGED = (EOFError, zlib.error, gzip.BadGzipFile)  # what a damaged .gz raises


def largest(packed: int) -> int:
    """What so many packed bytes may become at most [bytes]."""
    return max(_RATIO * packed, _FREE)


class TooLargeError(OSError):
    """What a compressed file unpacks to is more than is plausible, or than there is room for."""


def unpack(path: Path, target: Path, kind: str, magic: bytes) -> None:
    """Unpack a file of a kind (gzip or zstd) whose content begins with `magic`; raises OSError, EOFError."""
    limit = largest(path.stat().st_size)
    free = shutil.disk_usage(target.parent).free - _SPARE
    written = 0
    with path.open("rb") as packed, target.open("wb") as out:
        for block in _unpacked(packed, kind):
            if written < len(magic) and not _fits(block, magic, written):
                raise OSError("its compressed content does not begin as it should")
            written += len(block)
            if written > limit:
                raise TooLargeError(f"it unpacks to more than {_RATIO} times its size, which no log does")
            if written > free:
                raise TooLargeError(
                    f"it unpacks to more than the {max(free, 0) >> 20} MiB that are free in {target.parent}"
                )
            out.write(block)


def _fits(block: bytes, magic: bytes, at: int) -> bool:
    left = magic[at:]
    return block[: len(left)] == left[: len(block)]


def _unpacked(packed: IO[bytes], kind: str) -> Iterator[bytes]:
    """Pieces of what is in it, each of bounded size."""
    if kind == "gzip":
        file = gzip.GzipFile(fileobj=packed)
        while True:
            try:
                block = file.read(_BLOCK)
            except DAMAGED as error:
                raise EOFError(f"the compressed file is damaged: {error}") from error
            if not block:
                return
            yield block
    import zstandard

    unpacker = zstandard.ZstdDecompressor().decompressobj()
    try:
        while not unpacker.eof:
            if not (piece := packed.read(_PIECE)):
                raise EOFError("the compressed file ends too early")
            yield unpacker.decompress(piece)
    except zstandard.ZstdError as error:
        raise EOFError(f"the compressed file is damaged: {error}") from error
