"""The file of facts of a rig, written: what stands in it otherwise, comments too, stays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from palpate import OutputError
from palpate_engine import bounded_text, read_rig, write_whole
from tomlkit.exceptions import TOMLKitError

_HEAD = "Facts of the rig and its specimens, for palpate; docs/rig-facts.md explains each key."


def write_rig(path: Path, changes: Mapping[str, Any]) -> None:
    """Set or drop keys of a file of facts (TOML), which is created if missing, and removed with its last key.

    `changes` are values by key, None for a key that is dropped. Tables that do not change stay, with comments. Raises
    OutputError, ConfigurationError.
    """
    document = tomlkit.document()
    if path.is_file():
        read_rig(path)  # of one with mistakes it is said, and nothing is changed
        try:
            document = tomlkit.parse(bounded_text(path))
        except (OSError, TOMLKitError) as error:
            raise OutputError(f"{path}: cannot be changed: {error}") from error
    else:
        document.add(tomlkit.comment(_HEAD))
    tables = [key for key in document if isinstance(document[key], dict)]
    kept = {key: document.pop(key) for key in tables if key not in changes} if tables else {}
    for key, value in changes.items():
        if value is None:
            document.pop(key, None)
        else:
            document[key] = value
    for key, table in kept.items():  # behind the keys, which would be theirs otherwise
        document.add(key, table)
    text = tomlkit.dumps(document)
    if text.strip() == f"# {_HEAD}":
        path.unlink(missing_ok=True)
    else:
        write_whole(path, text)
