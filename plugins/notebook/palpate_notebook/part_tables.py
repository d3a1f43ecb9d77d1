"""Parts made in Python, as tables of a pipeline file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, Part
from palpate_engine import Registry, Source, plain_settings

_UNCHECKED = "unchecked"  # key that marks settings as not to be doubted


def source_of(name: str, path: Path, tables: dict[str, Any]) -> Source:
    """Return the tables as the pipeline of a record; raises ConfigurationError for what TOML cannot hold."""
    try:
        return Source(tomli_w.dumps(tables), path)
    except TypeError as error:
        raise ConfigurationError(
            f"{name}: contains something that cannot be written in a pipeline file: {error}"
        ) from error


def part_tables(parts: Sequence[str | Part], kind: str, parts_registry: Registry, with_tip: bool) -> dict[str, Any]:
    """Return the table of each part, given as a part or by name, under a label of its own.

    `with_tip`: named models refer to the table of the tip; otherwise a model that needs one raises ConfigurationError.
    """
    tables: dict[str, Any] = {}
    for part in parts:
        if isinstance(part, str):
            label = part
            table = _named_part_table(part, kind, parts_registry, with_tip)
        else:
            table = table_of(part, kind, kind, parts_registry)
            label = table["type"]
        same_labels = sum(key == label or key.startswith(f"{label}_") for key in tables)
        tables[f"{label}_{same_labels + 1}" if same_labels else label] = table
    return tables


def _named_part_table(name: str, kind: str, parts_registry: Registry, with_tip: bool) -> dict[str, Any]:
    """Return the table of a part by name; see `part_tables`."""
    table: dict[str, Any] = {"type": parts_registry.named(kind, name)}
    tip_field = parts_registry.find(kind, table["type"]).model_fields.get("indenter")
    if tip_field is not None and (with_tip or tip_field.is_required()):
        if not with_tip:
            raise ConfigurationError(f'{kind} {name!r} needs a tip, such as tip=Sphere(radius="5 mm")')
        table["indenter"] = "tip"
    return table


def table_of(part: object, label: str, kind: str, parts_registry: Registry) -> dict[str, Any]:
    """Return a part as a table of a pipeline file; `label` names it in messages.

    Raises ConfigurationError for another object, or for a part that no installed plugin has.
    """
    if not isinstance(part, Part) or part.kind != kind:
        raise ConfigurationError(f"{label}: {part!r} is neither of kind {kind} nor the name of such a part")
    if not any(entry.part is type(part) for entry in parts_registry.parts[kind].values()):
        raise ConfigurationError(
            f"{label}: {type(part).__name__} is a part of no plugin: a distribution offers it by a hook, or a file "
            "next to a pipeline does, in [run] plugins"
        )
    table: dict[str, Any] = _without_marks(plain_settings(part, parts_registry))
    return table


def _without_marks(setting: Any) -> Any:
    """Return a setting without marks `unchecked` at any depth: its numbers are doubted like those of a file."""
    if isinstance(setting, dict):
        return {key: _without_marks(entry) for key, entry in setting.items() if key != _UNCHECKED}
    if isinstance(setting, list):
        return [_without_marks(entry) for entry in setting]
    return setting
