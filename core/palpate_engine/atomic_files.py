"""Files that are whole or not there: written next to their place, synced to the disk, then renamed; others in place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import ELOOP
from pathlib import Path
from typing import IO, Any

from palpate.errors import OutputError

_MODE = 0o666  # read and write for everybody, less the umask: as any new file
_MAX_NAME_LENGTH = 200  # characters of a temporary file's name, of 255 bytes that file systems allow


@contextmanager
def whole_file(path: Path, binary: bool = False) -> Iterator[IO[Any]]:
    """Yield a file to write that takes its name when the context ends well: until then an older one stays as it was.

    What is not an ordinary file, such as /dev/stdout, is written at once. Raises OutputError.
    """
    direct = path.exists() and not path.is_file()
    partial = path if direct else path.with_name(f".{path.name[:_MAX_NAME_LENGTH]}.{os.getpid()}.part")
    options: dict[str, Any] = {} if binary else {"newline": "", "encoding": "utf-8"}
    try:
        with open(partial, "wb" if binary else "w", opener=None if direct else _no_link, **options) as file:
            yield file
            file.flush()
            if not direct:
                os.fsync(file.fileno())
        if not direct:
            partial.replace(path)
            _keep_name(path.parent)
    except BaseException as error:
        if not direct:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            raise OutputError(f"{path}: cannot write: {error.strerror or error}") from error
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file that is whole or not there, over an older one of its name; raises OutputError."""
    with whole_file(path, isinstance(content, bytes)) as file:
        file.write(content)


def write_new(path: Path, text: str) -> None:
    """Write a file, whole or not at all, that must not exist yet; raises OutputError."""
    if path.exists():
        raise OutputError(f"{path}: cannot write: exists already")
    write_whole(path, text)


def _no_link(path: str, flags: int) -> int:
    """Open a file, and no link in its place: an `opener` of `open`."""
    return os.open(path, flags | os.O_NOFOLLOW, _MODE)


@contextmanager
def file_in_place(path: Path) -> Iterator[IO[bytes]]:
    """Yield a file to read and change where it stands, created if missing; raises OutputError.

    A link is refused: it may lead out of the folder, to a file of the user that nobody has named.
    """
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, _MODE)
        with os.fdopen(handle, "r+b") as file:
            yield file
    except OSError as error:
        reason = "is a link" if error.errno == ELOOP else error.strerror or error
        raise OutputError(f"{path}: cannot write: {reason}") from error


def _keep_name(folder: Path) -> None:
    """Bring the new name to the disk, too, where the file system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
