"""ROS 2 message definitions: the text in a log or a pipeline, parsed into fields."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

from palpate import LogError

from palpate_records.messages.fields import Field as Field
from palpate_records.messages.idl_definitions import is_idl, parse_idl
from palpate_records.messages.standard_types import STANDARD_TYPES

# Codes of numpy by name.
PRIMITIVES: Mapping[str, str] = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "u2",
    "int16": "i2",
    "uint32": "u4",
    "int32": "i4",
    "uint64": "u8",
    "int64": "i8",
    "float32": "f4",
    "float64": "f8",
}
TEXT_LIMIT = 1 << 20  # characters of one definition; longer is damage: a choice
_MAX_DEPTH = 32  # of types within types: a choice
_MAX_ELEMENTS = (1 << 32) - 1  # of an array, by CDR
_MAX_SHOWN = 60  # characters of a line in a message: a choice
_TEXT_TYPES = ("string", "wstring")
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=\d+|\d*)\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)$"
)
_SEPARATOR = re.compile(r"^=+\s*$", re.MULTILINE)


Definitions = Mapping[str, tuple[Field, ...]]

_BUILT_IN = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
_SHORT_NAMES = {"Header": "std_msgs/Header"}  # of types that need no package
_ROS1_NAMES = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}


def short_name(name: str) -> str:
    """Return a type's name without the ``msg`` that some writers put in.

    >>> short_name("geometry_msgs/msg/Wrench")
    'geometry_msgs/Wrench'
    """
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name


@cache
def parse_definitions(name: str, text: str, ros1: bool = False) -> Definitions:
    """Return every type that a message type needs, by its short name.

    Types that the text leaves out are taken from the standard ones of ROS 2. Those of ROS 1 differ: its definitions are
    whole, time and duration are built in, and a byte has a sign. Raises LogError for a text that is not a definition,
    names a type that is not defined, or is cyclic.
    """
    if len(text) > TEXT_LIMIT:
        raise LogError(f"the definition of {name} has {len(text)} characters; more than {TEXT_LIMIT} is damage")
    standard_types = {key: STANDARD_TYPES[key] for key in _BUILT_IN} if ros1 else STANDARD_TYPES
    root = short_name(name)
    if not text.strip():
        text = _standard_text(name, standard_types)
    if not ros1 and is_idl(text):
        types = parse_idl(name, text)
        if root not in types:
            raise LogError(f"the IDL does not define {name} (but {', '.join(types) or 'nothing'})")
    else:
        types = _parse_sections(name, text)
    _add_standard_types(root, types, standard_types)
    if ros1:
        return {key: tuple(map(_with_signed_byte, fields)) for key, fields in types.items()}
    return types


def _standard_text(name: str, standard_types: Mapping[str, str]) -> str:
    """Return the definition of a type that a log does not define; raises LogError for one that is not standard."""
    root = short_name(name)
    if root not in standard_types and root != "std_msgs/Empty":
        raise LogError(f"the log does not define {name or 'the type'}, and it is not a standard type")
    return standard_types.get(root, "")


def _parse_sections(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Return the fields of a type, and of those that follow it in sections that begin with their names."""
    first_section, *sections = _SEPARATOR.split(text)
    types = {short_name(name): _parse_fields(first_section, name)}
    for section in sections:
        head, _, body = section.strip().partition("\n")
        if not head.startswith("MSG:"):
            raise LogError(f"the definition of {name} is damaged: a part of it has no name")
        type_name = short_name(head[4:].strip())
        types[type_name] = _parse_fields(body, type_name)
    return types


def _with_signed_byte(field: Field) -> Field:
    """Return a field of ROS 1, whose byte has a sign."""
    return replace(field, type="int8") if field.type == "byte" else field


def _parse_fields(text: str, owner: str) -> tuple[Field, ...]:
    """Return the fields in the lines of a definition; raises LogError for a line that is not a field."""
    package = owner.split("/")[0]
    fields = []
    for line in text.splitlines():
        declaration = _without_comment(line)
        if not declaration:
            continue
        match = _FIELD.match(declaration)
        if match is None:
            raise LogError(f"the definition of {owner} is damaged: {declaration[:_MAX_SHOWN]!r} is not a field")
        if match["rest"].startswith("="):  # a constant takes no place in a message
            continue
        fields.append(_parse_field(match["type"], match["array"], match["name"], package))
    return tuple(fields)


def _parse_field(type_name: str, array: str | None, name: str, package: str) -> Field:
    """Return a field, with the full name of its type, such as "std_msgs/Header".

    `array` is what stands behind the type: "[3]", "[]" and "[<=3]" for any number, None for no array. Raises LogError
    for an array without elements, or of too many: it would take no bytes of a message.
    """
    if type_name not in PRIMITIVES and type_name not in _TEXT_TYPES:
        type_name = short_name(_SHORT_NAMES.get(type_name, type_name))
        type_name = _ROS1_NAMES.get(type_name, type_name)
        type_name = type_name if "/" in type_name else f"{package}/{type_name}"
    if array is None:
        return Field(name, type_name)
    size = array[1:-1]
    if not size or size.startswith("<="):
        return Field(name, type_name, None, many=True)
    if len(size) > len(str(_MAX_ELEMENTS)) or not 1 <= int(size) <= _MAX_ELEMENTS:
        raise LogError(
            f"the definition of {package} is damaged: {name} has {size[:20]} elements (1 to {_MAX_ELEMENTS} can be)"
        )
    return Field(name, type_name, int(size), many=True)


def _without_comment(line: str) -> str:
    """Return the line up to a ``#`` that is not within a quoted default."""
    quote = ""
    for i, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#":
            return line[:i].strip()
    return line.strip()


def _add_standard_types(root: str, types: dict[str, tuple[Field, ...]], standard_types: Mapping[str, str]) -> None:
    """Add the standard types that definitions name; raises LogError for one that is not defined, and for cycles."""
    path: list[str] = []
    visited: set[str] = set()

    def visit(name: str) -> None:
        """Visit the types of the fields of a type, in depth."""
        if name in visited:
            return
        if name in path or len(path) > _MAX_DEPTH:
            raise LogError(f"the definition of {root} is damaged: {name} contains itself")
        if name not in types:
            if name not in standard_types:
                raise LogError(f"the definition of {root} names {name}, which the log does not define")
            types[name] = _parse_fields(standard_types[name], name)
        path.append(name)
        for field in types[name]:
            if field.type not in PRIMITIVES and field.type not in _TEXT_TYPES:
                visit(field.type)
        path.pop()
        visited.add(name)

    visit(root)
