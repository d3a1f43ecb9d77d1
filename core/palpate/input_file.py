"""Input files: regular, of bounded size and nesting; those of a log's pipeline in the folder of the log."""

from __future__ import annotations

import errno
import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import Any

LARGEST = 1 << 25  # [bytes], a choice: of a file from which a pipeline takes data
_MAX_SHOWN = 80  # characters, a choice: of a path in a message
_MAX_TEXT = 1 << 28  # [bytes], a choice: of a text that is read at once, such as the fits of ten thousand logs
_TOO_DEEP = "tables and lists are nested too deep"


@dataclass(frozen=True)
class Enclosure:
    """The files of a pipeline that a log carries: those in the log's folder, and those that it was recorded with."""

    log: Path
    digests: frozenset[str] = frozenset()  # SHA-256 of the files that it was recorded with, as the log states them

    def admits(self, path: Path) -> bool:
        """Return True if a file may be read; symbolic links are followed first."""
        if path.resolve().is_relative_to(self.log.parent.resolve()):
            return True
        if not (path.is_file() and 0 < path.stat().st_size <= LARGEST):  # files of a device driver have no size
            return False
        return hashlib.sha256(path.read_bytes()).hexdigest() in self.digests


def check_input(path: Path, enclosure: Enclosure | None = None) -> None:
    """Raise ValueError where a file must not be read; a missing one is left to its reader.

    With an `enclosure`, that of a pipeline which a log carries, only the files that it admits are read.
    """
    try:
        status = path.stat()
    except ValueError as error:
        raise ValueError(f"{str(path)[:_MAX_SHOWN]!r}: no file can have this name ({error})") from error
    except OSError:
        return
    if not S_ISREG(status.st_mode):
        raise ValueError(f"{path}: is not a regular file; name a file on a disk")
    if status.st_size > LARGEST:
        raise ValueError(f"{path}: has {status.st_size} bytes; at most {LARGEST} are read")
    if enclosure is not None and not enclosure.admits(path):
        raise ValueError(
            f"{path}: is outside the folder of {enclosure.log.name}, the log that names it, and its contents are "
            "not those of the recording; put the file of the recording there, or name it in a pipeline file of your own"
        )


def bounded_text(path: Path, encoding: str = "utf-8") -> str:
    """Return the text of a file; raises UnicodeDecodeError, and OSError if it is not regular or far too large."""
    status = path.stat()
    if not S_ISREG(status.st_mode):  # a pipe would be waited for, and a device has no end
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    if status.st_size > _MAX_TEXT:
        raise OSError(errno.EFBIG, f"has {status.st_size} bytes; at most {_MAX_TEXT} are read", str(path))
    return path.read_text(encoding=encoding)


def json_document(text: str) -> Any:
    """Return the data of a text of JSON; raises ValueError, also for one that is nested too deep."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError(_TOO_DEEP) from error


def toml_tables(text: str) -> dict[str, Any]:
    """Return the tables of a text of TOML; raises tomllib.TOMLDecodeError, also for one that is nested too deep."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (ValueError, RecursionError) as error:  # of a number of 5000 digits, too
        raise tomllib.TOMLDecodeError(_TOO_DEEP if isinstance(error, RecursionError) else str(error)) from error
