"""Machine code kept on disk from one run to the next, in a folder that no other user can write to.

Code is executed, so that only what this user wrote is read: the folder is the user's own and closed to all others,
a file is not a link, and its first bytes are the SHA-256 of the rest. Whatever is not so is as if it were not there. A
file's name is the SHA-256 of all that the code follows from, the processor among it: machines may share a home.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

_VARIABLE = "PALPATE_CACHE"
_MAX_FILES = 512  # the oldest go: a choice
_SUM = sha256().digest_size
_PRIVATE, _OTHERS = 0o700, 0o077  # permissions of a folder of the user alone; those of all others


def cached_code(causes: tuple[str, ...], make: Callable[[], bytes]) -> bytes:
    """Return code that follows from its causes: read where it is kept, else made, and kept where that can be."""
    folder = _folder()
    if folder is None:
        return make()
    file = folder / sha256("\0".join(causes).encode()).hexdigest()
    if (code := _read(file)) is None:
        code = make()
        _write(file, code)
    return code


def _folder() -> Path | None:
    """Return the user's own folder, closed to others; None without one, or with ``PALPATE_CACHE=off``."""
    requested = os.environ.get(_VARIABLE)
    if requested == "off":
        return None
    try:
        base = (
            Path(requested)
            if requested
            else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "palpate"
        )
        folder = base / "kernels"
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
        status = folder.lstat()
    except (OSError, RuntimeError):  # a disk that cannot be written to; no home
        return None
    is_private = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & _OTHERS
    return folder if is_private else None


def _read(file: Path) -> bytes | None:
    """Return the code of a file; None if it is missing, another user's, a link, or not what was written."""
    try:
        with open(os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as opened:
            status = os.fstat(opened.fileno())
            if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & _OTHERS:
                return None
            stated, code = opened.read(_SUM), opened.read()
    except OSError:
        return None
    return code if sha256(code).digest() == stated else None


def _write(file: Path, code: bytes) -> None:
    """Keep code, whole or not at all."""
    with contextlib.suppress(OSError):  # a full disk
        handle, partial = tempfile.mkstemp(dir=file.parent)  # 0600
        try:
            with open(handle, "wb") as opened:
                opened.write(sha256(code).digest() + code)
            os.replace(partial, file)
        except OSError:
            os.unlink(partial)
            raise
        files = sorted(file.parent.iterdir(), key=lambda path: path.lstat().st_mtime)
        for old in files[:-_MAX_FILES]:
            old.unlink(missing_ok=True)
