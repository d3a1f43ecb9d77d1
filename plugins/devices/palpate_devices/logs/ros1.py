"""ROS 1 messages, read by a library that makes a program of each definition and executes it.

What it is given is written anew: names that are names, types and sizes; no constant, comment or default of the log.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from palpate import LogError

from palpate_devices.logs.cdr import walk_ros1
from palpate_devices.logs.definitions import PRIMITIVES, TEXT_LIMIT, Definitions, parse_definitions
from palpate_devices.logs.topics import Topic

_TYPE = r"[A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z][A-Za-z0-9_]*)?"
_FIELD = re.compile(rf"({_TYPE}(?:\[[0-9]{{0,10}}\])?)[ \t]+([A-Za-z][A-Za-z0-9_]*)")
_CONSTANT = re.compile(rf"{_TYPE}[ \t]+[A-Za-z][A-Za-z0-9_]*[ \t]*=.*")
_PART = re.compile(rf"MSG:[ \t]*({_TYPE})")
_NAME = re.compile(_TYPE)
_WALKED = 1 << 15  # [bytes] from which on a message is walked before the library makes objects of it


def plain_definition(name: str, text: str) -> str:
    """The fields of a definition, and nothing else; raises LogError where a line is neither field nor constant."""
    if not _NAME.fullmatch(name):
        raise LogError(f"{name[:60]!r} is not the name of a message type")
    if len(text) > TEXT_LIMIT:
        raise LogError(f"the definition of {name} has {len(text)} characters; more than {TEXT_LIMIT} is damage")
    lines = []
    for line in text.splitlines():
        words = line.partition("#")[0].strip()
        if not words or words.startswith("==="):
            lines += ["=" * 80] if words else []
        elif part := _PART.fullmatch(words):
            lines.append(f"MSG: {part[1]}")
        elif field := _FIELD.fullmatch(words):
            lines.append(f"{field[1]} {field[2]}")
        elif not _CONSTANT.fullmatch(words):
            raise LogError(f"the definition of {name} is damaged: {words[:60]!r} is no field")
    return "\n".join(lines)


def ros1_parser(topic: Topic) -> Callable[[bytes], Any] | None:
    """What reads the messages of a topic; None where the library is not installed. Raises LogError."""
    try:
        from mcap_ros1.decoder import DecoderFactory
    except ImportError:
        return None
    from mcap.records import Schema

    text = plain_definition(topic.type, topic.schema.decode(errors="replace"))
    definitions = parse_definitions(topic.type, text)
    _refuse_nothing(definitions, topic.type)
    try:
        made = DecoderFactory().decoder_for("ros1", Schema(1, text.encode(), "ros1msg", topic.type))
    except Exception as error:  # it says in one of many ways that it cannot read the definition
        raise LogError(f"the definition of {topic.type} cannot be read: {error}") from error
    load: Any = made

    def parse(message: bytes) -> Any:
        if len(message) > _WALKED:
            walk_ros1(definitions, topic.type, message)
        return load(message)

    return parse


def _refuse_nothing(definitions: Definitions, name: str) -> None:
    """Refuse arrays whose elements take no bytes of a message: 4 bytes could state that there are 2^32 of them."""

    def empty(kind: str) -> bool:
        fields = definitions.get(kind, ())
        plain = any(field.type in PRIMITIVES or field.type == "string" or field.count is None for field in fields)
        return kind in definitions and not plain and all(empty(field.type) for field in fields)

    for fields in definitions.values():
        for field in fields:
            if field.many and empty(field.type):
                raise LogError(f"the definition of {name} is damaged: {field.name} is an array of nothing")
