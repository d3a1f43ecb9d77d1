"""Files that are read: regular, of bounded size and nesting; those of a log's pipeline in the folder of the log."""

from __future__ import annotations

import errno
import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import Any

LARGEST = 1 << 25  # [bytes] of a file that a pipeline takes data from
_TEXT = 1 << 28  # [bytes] of a text that is read at once: the fits of ten thousand logs
_DEEP = "tables and lists are nested too deep"


@dataclass(frozen=True)
class Enclosure:
    """What a pipeline that a log carries may read: files in the log's folder, and those that it was recorded with."""

    log: Path
    digests: frozenset[str] = frozenset()  # SHA-256 of the files that it was recorded with, as the log states them

    def admits(self, path: Path) -> bool:
        """Whether a file may be read; symbolic links are followed first."""
        if path.resolve().is_relative_to(self.log.parent.resolve()):
            return True
        if not (path.is_file() and 0 < path.stat().st_size <= LARGEST):  # files of a device driver have no size
            return False
        return hashlib.sha256(path.read_bytes()).hexdigest() in self.digests


def check_input(path: Path, enclosure: Enclosure | None = None) -> None:
    """Raise ValueError where a file must not be read; one that is not there is left to whoever reads it."""
    try:
        status = path.stat()
    except ValueError as error:
        raise ValueError(f"{str(path)[:80]!r}: no file can have this name ({error})") from error
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
    """The text of a file; raises UnicodeDecodeError, and OSError where it is not a regular file or far too large."""
    status = path.stat()
    if not S_ISREG(status.st_mode):  # a pipe would be waited for, and a device has no end
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    if status.st_size > _TEXT:
        raise OSError(errno.EFBIG, f"has {status.st_size} bytes; at most {_TEXT} are read", str(path))
    return path.read_text(encoding=encoding)


def json_document(text: str) -> Any:
    """What a text of JSON says; raises ValueError, for one that is nested too deep as well."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError(_DEEP) from error


def toml_tables(text: str) -> dict[str, Any]:
    """The tables of a text of TOML; raises tomllib.TOMLDecodeError, for one that is nested too deep as well."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except (ValueError, RecursionError) as error:  # of a number of 5000 digits, too
        raise tomllib.TOMLDecodeError(_DEEP if isinstance(error, RecursionError) else str(error)) from error
