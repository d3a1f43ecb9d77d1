"""Type hashes of ROS 2 (RIHS01, REP 2011 and 2016): SHA-256 of a type's definition, with all types in it."""

from __future__ import annotations

import json
from functools import cache
from hashlib import sha256
from typing import Any

from palpate_records.messages.definitions import PRIMITIVES, Definitions, Field, parse_definitions, short_name

# Codes of type_description_interfaces/FieldType.
_NESTED = 1
_ARRAY_OFFSET = 48  # added to the code of the elements of an array of fixed length
_SEQUENCE_OFFSET = 144  # added to that of an unbounded sequence
_TYPE_CODES = {
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
    referenced = sorted(_contained_types(root, definitions) - {root})
    description = {
        "type_description": _type_description(root, definitions),
        "referenced_type_descriptions": [_type_description(name, definitions) for name in referenced],
    }
    return f"RIHS01_{sha256(json.dumps(description).encode()).hexdigest()}"


def _contained_types(name: str, definitions: Definitions) -> set[str]:
    """Return the names of a type and of all types within it, at any depth."""
    field_types = {field.type for field in definitions[name] if field.type in definitions}
    return {name}.union(*(_contained_types(field_type, definitions) for field_type in field_types))


def _type_description(name: str, definitions: Definitions) -> dict[str, Any]:
    """Return a type_description_interfaces/IndividualTypeDescription; the order of its keys is part of the hash."""
    fields = [{"name": field.name, "type": _field_type(field)} for field in definitions[name]]
    return {"type_name": _full_name(name), "fields": fields}


def _field_type(field: Field) -> dict[str, Any]:
    """Return a type_description_interfaces/FieldType; the order of its keys is part of the hash."""
    is_nested = field.type not in PRIMITIVES and field.type not in _TYPE_CODES
    type_code = _NESTED if is_nested else _TYPE_CODES[field.type]
    length = 0
    if field.many and field.count is None:
        type_code += _SEQUENCE_OFFSET
    elif field.many and field.count is not None:
        type_code += _ARRAY_OFFSET
        length = field.count
    return {
        "type_id": type_code,
        "capacity": length,
        "string_capacity": 0,
        "nested_type_name": _full_name(field.type) if is_nested else "",
    }


def _full_name(short_type: str) -> str:
    """Return the name of a type with the ``msg`` between package and message."""
    package, _, message_name = short_type.partition("/")
    return f"{package}/msg/{message_name}"
