"""``palpate describe schema``: JSON schemas of pipeline files, for editors, and of ``result.json``, for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from palpate import OutputError, Settings
from palpate_engine import (
    DIALECT,
    FORMAT,
    KEY,
    KINDS,
    UNCHECKED,
    AlignmentSettings,
    Entry,
    Registry,
    RunSettings,
    SafetySettings,
    Signal,
    registry as registries,
)
from palpate_kit.runs.result_model import result_schema

_UNCHECKED = {
    "type": "array",
    "items": {"type": "string"},
    "description": "keys of this table whose numbers without a unit are intended",
}


def schema(
    of: Annotated[Literal["pipeline", "result"], typer.Argument(help="Of which file.")] = "pipeline",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write it to this file.")] = None,
) -> None:
    """Print the JSON schema of pipeline files, for editors that read the line `#:schema FILE` of a TOML file.

    `palpate describe schema result` prints that of result.json, for programs that read what a run found.
    """
    json_schema = pipeline_schema(registries.load()) if of == "pipeline" else result_schema()
    text = json.dumps(json_schema, indent=2)
    if output is None:
        typer.echo(text)
        return
    try:
        output.write_text(f"{text}\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{output}: cannot write: {error.strerror}") from error


def pipeline_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of every table, key and part of the loaded plugins."""
    definitions: dict[str, Any] = {"unchecked keys": _UNCHECKED}
    properties: dict[str, Any] = {
        KEY: {"type": "string", "description": f'version for which the file is written; currently "{FORMAT}"'},
        "run": _table(RunSettings, "run", definitions),
        "alignment": _table(AlignmentSettings, "alignment", definitions),
        "safety": _table(SafetySettings, "safety", definitions),
    }
    properties |= {name: _table(settings, name, definitions) for name, settings in registry.tables.items()}
    for kind, entries in registry.parts.items():
        properties[kind] = {"type": "object", "additionalProperties": {"$ref": f"#/$defs/{kind} table"}}
        definitions |= _kind(kind, entries, definitions)
    tables = {name: {"$ref": f"#/properties/{name}"} for name in properties}
    properties[DIALECT] = {
        "type": "object",
        "additionalProperties": {"type": "object", "properties": tables, "additionalProperties": False},
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "palpate pipeline",
        "type": "object",
        "properties": properties,
        "if": {"required": ["run"], "properties": {"run": {"required": ["base"]}}},  # which has what is not here
        "else": {"required": ["device", "alignment", "model", "estimator"]},
        "additionalProperties": False,
        "$defs": definitions,
    }


def _kind(kind: str, entries: Mapping[str, Entry], definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schemas of a kind of part: of its table, whose `type` chooses that of one part, and of a field.

    The tables of the parts are added to `definitions`. A choice by `if` and `then` lets a validator name the key that
    is wrong, where `oneOf` names every part.
    """
    choices, names = [], []
    for key, entry in entries.items():
        if entry.problem is not None:
            continue
        table = _table(entry.part, f"{kind}:{key}", definitions)
        table["properties"] = {"type": True, **table.get("properties", {})}
        definitions[f"{kind}:{key}"] = table
        part_names = list(dict.fromkeys((key, entry.qualified)))
        names += part_names
        name_schema: dict[str, Any] = {"const": key} if len(part_names) == 1 else {"enum": part_names}
        condition = {"required": ["type"], "properties": {"type": name_schema}}
        choices.append({"if": condition, "then": {"$ref": f"#/$defs/{kind}:{key}"}})
    return {
        f"{kind} table": {
            "type": "object",
            "required": ["type"],
            "properties": {"type": {"enum": names}},
            "allOf": choices,
        },
        # A part in a field is the name of a table, or the table itself.
        kind: {
            "if": {"type": "string"},
            "then": {"description": f"the NAME of a [{kind}.NAME]"},
            "else": {"$ref": f"#/$defs/{kind} table"},
        },
    }


def _table(settings: type[Settings], owner: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of one table; its references are defined under its owner's name, as plugins may share names."""
    schema = settings.model_json_schema(mode="validation", ref_template=f"#/$defs/{owner}.{{model}}")
    kinds = {root.__name__: kind for kind, (_, root) in KINDS.items()}
    for name, inner in schema.pop("$defs", {}).items():
        if name in kinds:
            inner = {"$ref": f"#/$defs/{kinds[name]}"}
        elif name == Signal.__name__:
            inner = {"anyOf": [{"type": "string", "description": "a channel"}, inner]}
        definitions[f"{owner}.{name}"] = inner
    for table in (schema, *definitions.values()):
        if table.get("additionalProperties") is False:
            table["properties"] = {**table.get("properties", {}), UNCHECKED: {"$ref": "#/$defs/unchecked keys"}}
    return schema
