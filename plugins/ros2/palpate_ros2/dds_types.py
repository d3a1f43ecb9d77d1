"""Message types for DDS, made of their ROS 2 definitions; messages stay the bytes that came."""

from __future__ import annotations

from dataclasses import make_dataclass
from functools import cache
from typing import Any

from palpate_records.messages.definitions import PRIMITIVES, Definitions, Field, parse_definitions, short_name

from palpate_ros2.names import dds_type

_SAME = {"byte": "uint8", "char": "uint8"}


@cache
def message_class(type_name: str, definition: str) -> Any:
    """Return the class of a message type for cyclonedds; raises LogError where the definition is invalid.

    Its messages are not taken apart: `data` is what came or is to go, encapsulation included, as a bag would hold it.
    """
    definitions = parse_definitions(type_name, definition)
    struct = _struct(short_name(type_name), definitions, {})

    def deserialize(cls: Any, data: bytes) -> Any:
        message = cls.__new__(cls)
        message.data = data
        return message

    def serialize(message: Any, *_: Any, **__: Any) -> bytes:
        return bytes(message.data)

    def deserialize_key(cls: Any, data: bytes) -> None:
        return None  # no message of ROS 2 has a key

    struct.serialize = serialize
    struct.deserialize, struct.deserialize_key = classmethod(deserialize), classmethod(deserialize_key)
    return struct


def _struct(name: str, definitions: Definitions, done: dict[str, Any]) -> Any:
    """Return an IdlStruct of one type, and of all types in it."""
    from cyclonedds.idl import IdlStruct

    if name not in done:
        fields = [(field.name, _annotation(field, definitions, done)) for field in definitions[name]]
        # An empty message has one byte, in ROS 2 as here: a structure of nothing is not allowed.
        fields = fields or [("structure_needs_at_least_one_member", _annotation(Field("", "uint8"), {}, {}))]
        made: Any = make_dataclass(name.rpartition("/")[2], fields, bases=(IdlStruct,))
        made.__idl_typename__ = dds_type(name)
        made.__idl__.idl_transformed_typename = dds_type(name)
        done[name] = made
    return done[name]


def _annotation(field: Field, definitions: Definitions, done: dict[str, Any]) -> Any:
    from cyclonedds.idl import types as idl_types

    types: Any = idl_types
    if field.type in ("string", "wstring"):
        kind: Any = str
    elif field.type == "bool":
        kind = bool
    elif field.type in PRIMITIVES:
        kind = getattr(types, _SAME.get(field.type, field.type))
    else:
        kind = _struct(field.type, definitions, done)
    if not field.many:
        return kind
    return types.sequence[kind] if field.count is None else types.array[kind, field.count]
