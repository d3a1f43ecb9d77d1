"""Parts of Python as tables of a pipeline file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, Part
from palpate_engine import Registry, Source, plain_settings

_UNCHECKED = "unchecked"


def source_of(name: str, path: Path, tables: dict[str, Any]) -> Source:
    """Return the tables as the pipeline of a record; raises ConfigurationError for what TOML cannot hold."""
    try:
        return Source(tomli_w.dumps(tables), path)
    except TypeError as error:
        raise ConfigurationError(
            f"{name}: contains something that cannot be written in a pipeline file: {error}"
        ) from error


def part_tables(given: Sequence[str | Part], kind: str, known: Registry, with_tip: bool) -> dict[str, Any]:
    """Return a table for each part, by a short name that no other has."""
    tables: dict[str, Any] = {}
    for part in given:
        if isinstance(part, str):
            label, table = part, {"type": known.named(kind, part)}
            wanted = known.find(kind, table["type"]).model_fields.get("indenter")
            if wanted is not None and (with_tip or wanted.is_required()):
                if not with_tip:
                    raise ConfigurationError(f'{kind} {part!r} needs a tip, such as tip=Sphere(radius="5 mm")')
                table["indenter"] = "tip"
        else:
            table = table_of(part, kind, kind, known)
            label = table["type"]
        count = sum(key == label or key.startswith(f"{label}_") for key in tables)
        tables[label if not count else f"{label}_{count + 1}"] = table
    return tables


def table_of(part: object, what: str, kind: str, known: Registry) -> dict[str, Any]:
    """Return a part as a table of a pipeline file; raises ConfigurationError for what is not a part of an installed
    plugin."""
    if not isinstance(part, Part) or part.kind != kind:
        raise ConfigurationError(f"{what}: {part!r} is neither of kind {kind} nor the name of such a part")
    if not any(entry.part is type(part) for entry in known.parts[kind].values()):
        raise ConfigurationError(
            f"{what}: {type(part).__name__} is a part of no plugin: a distribution offers it by a hook, or a file "
            "next to a pipeline does, in [run] plugins"
        )
    table: dict[str, Any] = _without_marks(plain_settings(part, known))
    return table


def _without_marks(value: Any) -> Any:
    """Numbers of a part in Python are doubted like those of a file."""
    if isinstance(value, dict):
        return {key: _without_marks(item) for key, item in value.items() if key != _UNCHECKED}
    return [_without_marks(item) for item in value] if isinstance(value, list) else value
