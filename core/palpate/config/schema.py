"""The JSON schema of a pipeline file, so that editors complete it."""

from __future__ import annotations

from typing import Any

from palpate.alignment import AlignmentSettings, Signal
from palpate.calibration import CalibrationSettings
from palpate.config.pipeline_file import RunSettings
from palpate.design import DesignSettings
from palpate.hooks import KINDS
from palpate.parts import Settings
from palpate.registry import Registry
from palpate.safety import SafetySettings

_SWEEP = {
    "type": "object",
    "description": 'for `palpate sweep`: lists of values by setting, such as "estimator.afukf.theta" = ["1 mm/s"]',
    "properties": {"combine": {"enum": ["grid", "list"], "default": "grid"}},
}


def pipeline_schema(registry: Registry) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of every table, key and part that the loaded plugins know."""
    definitions: dict[str, Any] = {}
    properties: dict[str, Any] = {
        "run": _table(RunSettings, definitions),
        "alignment": _table(AlignmentSettings, definitions),
        "sweep": _SWEEP,
        "calibration": _table(CalibrationSettings, definitions),
        "design": _table(DesignSettings, definitions),
        "safety": _table(SafetySettings, definitions),
    }
    for kind, entries in registry.parts.items():
        choices = []
        for name, entry in entries.items():
            table = _table(entry.part, definitions)
            table["properties"] = {"type": {"const": name}} | table.get("properties", {})
            table["required"] = ["type", *table.get("required", [])]
            definitions[f"{kind}:{name}"] = table
            choices.append({"$ref": f"#/$defs/{kind}:{name}"})
        properties[kind] = {"type": "object", "additionalProperties": {"oneOf": choices}}
        # A part in a field is the name of a table, or the table itself.
        root = KINDS[kind][1].__name__
        definitions[root] = {"anyOf": [{"type": "string", "description": f"the NAME of a [{kind}.NAME]"}, *choices]}
    signal = definitions[Signal.__name__]
    definitions[Signal.__name__] = {"anyOf": [{"type": "string", "description": "a channel"}, signal]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "palpate pipeline",
        "type": "object",
        "properties": properties,
        "required": ["device", "alignment", "model", "estimator"],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _table(settings: type[Settings], definitions: dict[str, Any]) -> dict[str, Any]:
    schema = settings.model_json_schema(mode="validation")
    definitions.update(schema.pop("$defs", {}))
    return schema
