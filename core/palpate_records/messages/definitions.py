"""ROS 2 message definitions: the text that a log or a pipeline carries, parsed into fields."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

from palpate import LogError

from palpate_records.messages.fields import Field as Field
from palpate_records.messages.idl_definitions import is_idl, parse_idl
from palpate_records.messages.standard_types import STANDARD_TYPES

# Name -> numpy code; what numpy cannot hold as a number is None.
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
TEXT_LIMIT = 1 << 20  # characters of one definition; longer is damage
_DEPTH_LIMIT = 32
_MOST = (1 << 32) - 1  # elements of an array
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=\d+|\d*)\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)$"
)
_SEPARATOR = re.compile(r"^=+\s*$", re.MULTILINE)


Definitions = Mapping[str, tuple[Field, ...]]

_BUILT_IN = ("builtin_interfaces/Time", "builtin_interfaces/Duration")


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
    whole, time and duration are built in, and a byte has a sign. Raises LogError where the text is not a definition,
    names a type that is nowhere, or is cyclic.
    """
    if len(text) > TEXT_LIMIT:
        raise LogError(f"the definition of {name} has {len(text)} characters; more than {TEXT_LIMIT} is damage")
    known = {key: STANDARD_TYPES[key] for key in _BUILT_IN} if ros1 else STANDARD_TYPES
    if not text.strip() and short_name(name) in known:
        text = known[short_name(name)]
    elif not text.strip() and short_name(name) != "std_msgs/Empty":
        raise LogError(f"the log does not define {name or 'the type'}, and it is not a standard type")
    if not ros1 and is_idl(text):
        found = parse_idl(name, text)
        if short_name(name) not in found:
            raise LogError(f"the IDL does not define {name} (but {', '.join(found) or 'nothing'})")
        _complete(short_name(name), found, known)
        return found
    first, *rest = _SEPARATOR.split(text)
    found = {short_name(name): _fields(first, name)}
    for section in rest:
        head, _, body = section.strip().partition("\n")
        if not head.startswith("MSG:"):
            raise LogError(f"the definition of {name} is damaged: a part of it has no name")
        other = short_name(head[4:].strip())
        found[other] = _fields(body, other)
    _complete(short_name(name), found, known)
    if ros1:
        return {key: tuple(_with_sign(field) for field in fields) for key, fields in found.items()}
    return found


def _with_sign(field: Field) -> Field:
    return replace(field, type="int8") if field.type == "byte" else field


def _fields(text: str, owner: str) -> tuple[Field, ...]:
    package = owner.split("/")[0]
    fields = []
    for line in text.splitlines():
        words = _without_comment(line)
        if not words:
            continue
        match = _FIELD.match(words)
        if match is None:
            raise LogError(f"the definition of {owner} is damaged: {words[:60]!r} is not a field")
        if match["rest"].startswith("="):  # a constant takes no place in a message
            continue
        fields.append(_field(match["type"], match["array"], match["name"], package))
    return tuple(fields)


def _field(kind: str, array: str | None, name: str, package: str) -> Field:
    """Return a field; raises LogError where it is an array of nothing, whose elements would take no bytes of a
    message."""
    if kind not in PRIMITIVES and kind not in ("string", "wstring"):
        kind = short_name({"Header": "std_msgs/Header"}.get(kind, kind))
        kind = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}.get(kind, kind)
        kind = kind if "/" in kind else f"{package}/{kind}"
    if array is None:
        return Field(name, kind)
    inside = array[1:-1]
    if not inside or inside.startswith("<="):
        return Field(name, kind, None, many=True)
    if len(inside) > len(str(_MOST)) or not 1 <= int(inside) <= _MOST:
        raise LogError(
            f"the definition of {package} is damaged: {name} has {inside[:20]} elements (1 to {_MOST} can be)"
        )
    return Field(name, kind, int(inside), many=True)


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


def _complete(root: str, found: dict[str, tuple[Field, ...]], known: Mapping[str, str]) -> None:
    """Add known types that are named but not given; refuse what is nowhere, and cycles."""
    path: list[str] = []
    done: set[str] = set()

    def visit(name: str) -> None:
        if name in done:
            return
        if name in path or len(path) > _DEPTH_LIMIT:
            raise LogError(f"the definition of {root} is damaged: {name} contains itself")
        if name not in found:
            if name not in known:
                raise LogError(f"the definition of {root} names {name}, which the log does not define")
            found[name] = _fields(known[name], name)
        path.append(name)
        for field in found[name]:
            if field.type not in PRIMITIVES and field.type not in ("string", "wstring"):
                visit(field.type)
        path.pop()
        done.add(name)

    visit(root)
