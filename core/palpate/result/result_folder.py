"""The run folder: made once, never written over."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from palpate.errors import OutputError

PIPELINE, GIVEN, RESULT = "pipeline.toml", "given.toml", "result.json"
# Of result.json: 1 had flags as texts, no verdict and no number of its own; to 2 a sweep's values were its last ones;
# to 3 the standstill of a live run was `rest`.
SCHEMA = 4


def make_folder(name: str, wanted: Path | None, now: datetime) -> Path:
    """A new, empty folder: the one that is wanted, or ``runs/<date>_<time>_<name>``.

    Raises OutputError where it cannot be made, or where the wanted one already holds something.
    """
    try:
        if wanted is not None:
            wanted.mkdir(parents=True, exist_ok=True)
            if any(wanted.iterdir()):
                raise OutputError(f"{wanted}: the output folder is not empty, and nothing is ever overwritten")
            return wanted
        slug = re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip("-") or "run"
        stem = Path("runs") / f"{now:%Y-%m-%d_%H-%M-%S}_{slug}"
        for count in range(1, 1000):
            folder = stem if count == 1 else stem.with_name(f"{stem.name}_{count}")
            try:
                folder.mkdir(parents=True)
                return folder
            except FileExistsError:
                continue
    except OSError as error:
        raise OutputError(f"{error.filename or wanted}: cannot make the output folder: {error.strerror}") from error
    raise OutputError(f"{stem}: there are too many runs of this name and second")


def withdraw_folder(folder: Path) -> None:
    """Remove the folder of a run that was refused before it recorded anything, and ``runs`` where that was all."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):  # it holds other runs
        if folder.parent.name == "runs":
            folder.parent.rmdir()
