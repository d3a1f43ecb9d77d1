"""Files that a pipeline takes data from: regular, of bounded size, and in the folder of the log that names them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG

LARGEST = 1 << 25  # [bytes] of a file that a pipeline takes data from


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
