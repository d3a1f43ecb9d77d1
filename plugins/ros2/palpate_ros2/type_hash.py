"""Type hashes of ROS 2 (RIHS01, REP 2011 and 2016): SHA-256 of a type's definition, with all types in it."""

from __future__ import annotations

import json
from functools import cache
from hashlib import sha256
from typing import Any

from palpate_records.messages.definitions import PRIMITIVES, Definitions, Field, parse_definitions, short_name

_NESTED, _SEQUENCE, _ARRAY = 1, 144, 48  # of type_description_interfaces/FieldType; the latter two are added
_KINDS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a standard type, none of which has bounds; raises LogError for any other type.

    >>> type_hash("std_msgs/msg/String")
    'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    """
    definitions = parse_definitions(type_name, "")
    root = short_name(type_name)
    others = sorted(_needed(root, definitions) - {root})
    described = {
        "type_description": _description(root, definitions),
        "referenced_type_descriptions": [_description(name, definitions) for name in others],
    }
    return f"RIHS01_{sha256(json.dumps(described).encode()).hexdigest()}"


def _needed(name: str, definitions: Definitions) -> set[str]:
    inside = {field.type for field in definitions[name] if field.type in definitions}
    return {name}.union(*(_needed(other, definitions) for other in inside))


def _description(name: str, definitions: Definitions) -> dict[str, Any]:
    fields = [{"name": field.name, "type": _field_type(field)} for field in definitions[name]]
    return {"type_name": _full(name), "fields": fields}


def _field_type(field: Field) -> dict[str, Any]:
    nested = field.type not in PRIMITIVES and field.type not in _KINDS
    kind = _NESTED if nested else _KINDS[field.type]
    kind += 0 if not field.many else _SEQUENCE if field.count is None else _ARRAY
    return {
        "type_id": kind,
        "capacity": field.count if field.many and field.count is not None else 0,
        "string_capacity": 0,
        "nested_type_name": _full(field.type) if nested else "",
    }


def _full(name: str) -> str:
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind}"
