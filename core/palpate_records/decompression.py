"""Compressed files, never unpacked beyond a plausible size, or beyond the free space."""

from __future__ import annotations

import gzip
import shutil
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

# Choices.
_BLOCK_SIZE = 1 << 18  # [bytes] that are unpacked at once
_ZSTD_PIECE_SIZE = 1 << 11  # [bytes] of zstd at once, which become at most 64 MiB
_MAX_RATIO = 200  # of the size of an unpacked bag to that of its file; real ones have 2 to 20
_SMALL_SIZE = 1 << 26  # [bytes], permitted whatever the ratio
_SPARE_SPACE = 1 << 28  # [bytes] of a disk that stay free
DAMAGED = (EOFError, zlib.error, gzip.BadGzipFile)  # errors of a damaged .gz


def largest(packed: int) -> int:
    """Return the largest plausible size [bytes] of the contents of packed bytes."""
    return max(_MAX_RATIO * packed, _SMALL_SIZE)


class TooLargeError(OSError):
    """A compressed file whose contents are larger than is plausible, or than the free space."""


def unpack(path: Path, target: Path, compression: str, magic: bytes) -> None:
    """Unpack a file of gzip or zstd into `target`; its content begins with `magic`, the mark of its format.

    Raises TooLargeError for a content beyond a plausible size or the free space, OSError, EOFError.
    """
    limit = largest(path.stat().st_size)
    free_space = shutil.disk_usage(target.parent).free - _SPARE_SPACE
    written = 0
    with path.open("rb") as packed, target.open("wb") as out:
        for block in _unpacked_blocks(packed, compression):
            if written < len(magic) and not _agrees(block, magic[written:]):
                raise OSError("its compressed content does not begin as it should")
            written += len(block)
            if written > limit:
                raise TooLargeError(f"it unpacks to more than {_MAX_RATIO} times its size, which no log does")
            if written > free_space:
                raise TooLargeError(
                    f"it unpacks to more than the {max(free_space, 0) >> 20} MiB that are free in {target.parent}"
                )
            out.write(block)


def _agrees(block: bytes, magic: bytes) -> bool:
    """Return True if the shorter of two texts is the begin of the longer one."""
    return block[: len(magic)] == magic[: len(block)]


def _unpacked_blocks(packed: IO[bytes], compression: str) -> Iterator[bytes]:
    """Yield the contents in blocks of bounded size; raises EOFError for damage."""
    if compression == "gzip":
        file = gzip.GzipFile(fileobj=packed)
        while True:
            try:
                block = file.read(_BLOCK_SIZE)
            except DAMAGED as error:
                raise EOFError(f"the compressed file is damaged: {error}") from error
            if not block:
                return
            yield block
    import zstandard

    unpacker = zstandard.ZstdDecompressor().decompressobj()
    try:
        while not unpacker.eof:
            if not (piece := packed.read(_ZSTD_PIECE_SIZE)):
                raise EOFError("the compressed file ends too early")
            yield unpacker.decompress(piece)
    except zstandard.ZstdError as error:
        raise EOFError(f"the compressed file is damaged: {error}") from error
