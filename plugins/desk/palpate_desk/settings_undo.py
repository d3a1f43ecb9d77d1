"""What undoes a change of settings, as commands: from the settings that there are before it."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from palpate_engine import RigFacts

from palpate_desk.action import Action, where_curve

_LATER = ("--no-refit", "")


def own_inverse(own: Mapping[str, Sequence[str]], names: Collection[str], key: str) -> list[Action]:
    """What brings a key of single curves back to what it is now."""
    found = []
    for name in names:
        before = next((text for text in own.get(name, ()) if text.partition("=")[0].strip() == key), None)
        change = ("--unset", key) if before is None else ("--set", before)
        found.append(Action("fit", (("--where", where_curve(name)), change, _LATER)))
    return found


def setting_inverse(tables: Mapping[str, Any], key: str) -> list[Action]:
    """What brings a key of all curves back to what it is now; nothing where it is not there yet."""
    value: Any = tables
    for part in key.split("."):
        value = value.get(part.strip()) if isinstance(value, Mapping) else None
    return [] if value is None else [Action("fit", (("--set", f"{key}={_toml(value)}"), _LATER))]


def fact_inverse(facts: RigFacts, keys: Collection[str]) -> list[Action]:
    """What brings facts back to what they are now."""
    changes = [
        ("--unset", f"rig.{key}") if (value := getattr(facts, key)) is None else ("--set", f"rig.{key}={_toml(value)}")
        for key in keys
    ]
    return [Action("fit", (*changes, _LATER))]


def tip_inverse(tables: Mapping[str, Any]) -> list[Action]:
    """What brings the tips back to what they are now."""
    settings = [("--set", f"indenter.{name}={_toml(table)}") for name, table in tables.get("indenter", {}).items()]
    return [Action("fit", (*settings, _LATER))]


def model_inverse(tables: Mapping[str, Any]) -> list[Action]:
    """What brings the model back to what it is now, with all of its numbers."""
    models = tables.get("model", {})
    if len(models) != 1:
        return []
    ((name, table),) = models.items()
    settings = [
        ("--set", f"model.{name}.{key}={_toml(value)}")
        for key, value in table.items()
        if key not in ("type", "indenter")
    ]
    return [Action("fit", (("--model", str(table["type"])), *settings, _LATER))]


def _toml(value: Any) -> str:
    """Return a value as TOML in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(key)} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return _text(value) if isinstance(value, str) else repr(value)


def _text(value: str) -> str:
    """Return a text of TOML, of which that of JSON is one but for a character that nobody can type."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
