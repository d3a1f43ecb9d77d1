"""Settings written into a pipeline file, whose comments and order stay."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from palpate import ConfigurationError, OutputError
from palpate_engine import write_new, write_whole
from tomlkit.exceptions import TOMLKitError

Edit = Mapping[str, Any]  # keys of a device's table, tables among them


def edited_text(text: str, device: str, changes: Edit) -> str:
    """Return the text of a pipeline with other settings of a device; raises ConfigurationError.

    A change is a value by its key, or a table of values, whose other keys stay.
    """
    # The device's table, in a document that keeps comments and order.
    try:
        document = tomlkit.parse(text)
        tables: Any = document
        table: Any = tables["device"][device]
    except (TOMLKitError, KeyError) as error:
        raise ConfigurationError(f"[device.{device}] cannot be written into the pipeline: {error}") from error
    for key, value in changes.items():
        if not isinstance(value, Mapping):
            table[key] = value
            continue
        if key not in table:
            table[key] = tomlkit.table()
        for name, entry in value.items():
            table[key][name] = entry
    return tomlkit.dumps(document)


def write_pipeline(file: Path, text: str, out: Path | None) -> Path | None:
    """Write a text to a new file, or over the pipeline; return the copy of the former one.

    None where nothing was there before. Raises OutputError.
    """
    if out is not None:
        write_new(out, text)
        return None
    # The first name that is not taken: FILE.before, FILE.1, FILE.2 ...
    copy, number = file.with_name(f"{file.name}.before"), 0
    while copy.exists():
        number += 1
        copy = file.with_name(f"{file.name}.{number}")
    try:
        former = file.read_bytes()
    except OSError as error:
        raise OutputError(f"{file}: cannot read: {error.strerror}") from error
    write_whole(copy, former)
    write_whole(file, text)
    return copy
