"""Commands that undo a change of settings, made from the settings before it."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from palpate_engine import RigFacts

from palpate_desk.action import Action, where_curve

_WITHOUT_REFIT = ("--no-refit", "")  # option


def own_inverse(own_settings: Mapping[str, Sequence[str]], names: Collection[str], key: str) -> list[Action]:
    """Return the commands that give a key of single curves its present value again.

    `own_settings`: assignments "key=value" of each curve's settings, by curve; `names` of the curves.
    """
    inverse = []
    for name in names:
        assignment = next((text for text in own_settings.get(name, ()) if text.partition("=")[0].strip() == key), None)
        change = ("--unset", key) if assignment is None else ("--set", assignment)
        inverse.append(Action("fit", (("--where", where_curve(name)), change, _WITHOUT_REFIT)))
    return inverse


def setting_inverse(tables: Mapping[str, Any], key: str) -> list[Action]:
    """Return the command that gives a key of all curves its present value again; none for a key that is not set."""
    setting: Any = tables
    for part in key.split("."):
        setting = setting.get(part.strip()) if isinstance(setting, Mapping) else None
    if setting is None:
        return []
    return [Action("fit", (("--set", f"{key}={_toml(setting)}"), _WITHOUT_REFIT))]


def fact_inverse(facts: RigFacts, keys: Collection[str]) -> list[Action]:
    """Return the command that states facts as at present, and no longer those that are open at present."""
    changes = []
    for key in keys:
        fact = getattr(facts, key)
        changes.append(("--unset", f"rig.{key}") if fact is None else ("--set", f"rig.{key}={_toml(fact)}"))
    return [Action("fit", (*changes, _WITHOUT_REFIT))]


def tip_inverse(tables: Mapping[str, Any]) -> list[Action]:
    """Return the command that sets the present tips again."""
    settings = [("--set", f"indenter.{name}={_toml(table)}") for name, table in tables.get("indenter", {}).items()]
    return [Action("fit", (*settings, _WITHOUT_REFIT))]


def model_inverse(tables: Mapping[str, Any]) -> list[Action]:
    """Return the command that sets the present model again, with all its settings; none if there are several."""
    models = tables.get("model", {})
    if len(models) != 1:
        return []
    ((name, table),) = models.items()
    settings = []
    for key, setting in table.items():
        if key not in ("type", "indenter"):
            settings.append(("--set", f"model.{name}.{key}={_toml(setting)}"))
    return [Action("fit", (("--model", str(table["type"])), *settings, _WITHOUT_REFIT))]


def _toml(setting: Any) -> str:
    """Return a setting as TOML in one line."""
    if isinstance(setting, Mapping):
        return "{" + ", ".join(f"{_toml_text(key)} = {_toml(entry)}" for key, entry in setting.items()) + "}"
    if isinstance(setting, list):
        return "[" + ", ".join(_toml(entry) for entry in setting) + "]"
    if isinstance(setting, bool):
        return "true" if setting else "false"
    return _toml_text(setting) if isinstance(setting, str) else repr(setting)


def _toml_text(text: str) -> str:
    """Return a text as TOML: as JSON, except for the character DEL, which TOML must have escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
