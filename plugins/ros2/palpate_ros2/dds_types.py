"""Message types for DDS, made of their ROS 2 definitions; messages stay the bytes that came."""

from __future__ import annotations

from dataclasses import make_dataclass
from functools import cache
from typing import Any

from palpate_records.messages.definitions import PRIMITIVES, Definitions, Field, parse_definitions, short_name

from palpate_ros2.names import dds_type

_UNSIGNED_BYTES = {"byte": "uint8", "char": "uint8"}  # aliases of ROS 2


@cache
def message_class(type_name: str, definition: str) -> Any:
    """Return the class of a message type for cyclonedds; raises LogError where the definition is invalid.

    Its messages are not decoded: `data` is the bytes that were received or are to be sent, with their encapsulation, as
    in a bag.
    """
    definitions = parse_definitions(type_name, definition)
    struct = _idl_struct(short_name(type_name), definitions, {})

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


def _idl_struct(type_name: str, definitions: Definitions, structs: dict[str, Any]) -> Any:
    """Return the IdlStruct of a type; adds it and those of the types in it to `structs`, by type name."""
    from cyclonedds.idl import IdlStruct

    if type_name not in structs:
        fields = [(field.name, _annotation(field, definitions, structs)) for field in definitions[type_name]]
        if not fields:  # IDL has no empty structure; ROS 2 puts this field of one byte into one
            fields = [("structure_needs_at_least_one_member", _annotation(Field("", "uint8"), {}, {}))]
        struct: Any = make_dataclass(type_name.rpartition("/")[2], fields, bases=(IdlStruct,))
        struct.__idl_typename__ = dds_type(type_name)
        struct.__idl__.idl_transformed_typename = dds_type(type_name)
        structs[type_name] = struct
    return structs[type_name]


def _annotation(field: Field, definitions: Definitions, structs: dict[str, Any]) -> Any:
    """Return the type annotation by which cyclonedds knows a field."""
    from cyclonedds.idl import types as idl_types

    types: Any = idl_types
    element: Any
    if field.type in ("string", "wstring"):
        element = str
    elif field.type == "bool":
        element = bool
    elif field.type in PRIMITIVES:
        element = getattr(types, _UNSIGNED_BYTES.get(field.type, field.type))
    else:
        element = _idl_struct(field.type, definitions, structs)
    if not field.many:
        return element
    return types.sequence[element] if field.count is None else types.array[element, field.count]
