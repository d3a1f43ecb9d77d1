"""The run folder: made once, never written over."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
from collections import deque
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from palpate.errors import OutputError

PIPELINE, GIVEN, RESULT = "pipeline.toml", "given.toml", "result.json"
_NAME_LENGTH = 20  # characters of a run's name in that of its folder; a choice: a command with it fits a terminal
# Of result.json: 1 had flags as texts, no verdict and no number of its own; to 2 a sweep's values were its last ones;
# to 3 the standstill of a live run was `rest`; to 4 open facts were flags, and `note` a verdict.
SCHEMA = 5  # of the layout of result.json
_CLAIMS = 16  # folders of this process that are locked at once
_claims: deque[int] = deque()


def make_folder(name: str, wanted: Path | None, now: datetime) -> Path:
    """Return a new, empty folder: the one that was requested, or ``runs/<date>_<time>_<name>``.

    Raises OutputError where it cannot be made, or if the requested one already holds something.
    """
    try:
        if wanted is not None:
            wanted.mkdir(parents=True, exist_ok=True)
            _demand_empty(wanted)
            _claim(wanted)
            _demand_empty(wanted)  # another run may have written, and ended, in between
            return wanted
        slug = re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip("-")[:_NAME_LENGTH].rstrip("-.") or "run"
        stem = Path("runs") / f"{now:%Y-%m-%d_%H-%M-%S}_{slug}"
        for count in range(1, 1000):  # a choice, far more than begin within a second
            folder = stem if count == 1 else stem.with_name(f"{stem.name}_{count}")
            try:
                folder.mkdir(parents=True)
                return folder
            except FileExistsError:
                continue
    except OSError as error:
        raise OutputError(f"{error.filename or wanted}: cannot make the output folder: {error.strerror}") from error
    raise OutputError(f"{stem}: there are too many runs of this name and second")


def _demand_empty(folder: Path) -> None:
    if any(folder.iterdir()):
        raise OutputError(f"{folder}: the output folder is not empty, and nothing is ever overwritten")


def _claim(folder: Path) -> None:
    """Lock a folder that is empty yet, so that of two runs that begin at once only one writes there.

    Raises OutputError where another one has the lock; a file system without locks has none.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise OutputError(f"{folder}: another run has just begun to write there") from error
    except OSError:  # a file system without locks
        os.close(handle)
        return
    _claims.append(handle)
    if len(_claims) > _CLAIMS:  # that of a run which has long written its first files
        os.close(_claims.popleft())


def withdraw_folder(folder: Path) -> None:
    """Remove the folder of a run that was refused before it recorded anything, and ``runs`` where that was all."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):  # it holds other runs
        if folder.parent.name == "runs":
            folder.parent.rmdir()
