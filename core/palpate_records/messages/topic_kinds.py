"""Topics with several kinds of messages: valid in every format of logs, and each kind needs a decoder of its own."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from dataclasses import replace
from typing import TypeVar

from palpate import LogError

from palpate_records.messages.definitions import parse_definitions, short_name
from palpate_records.messages.topics import Topic

_Key = TypeVar("_Key", bound=Hashable)


def named_by_kind(channels: Mapping[_Key, Topic]) -> dict[_Key, Topic]:
    """Topics under a name for each kind of messages: ``/arm(Wrench)`` and ``/arm(Pose)`` where /arm has both."""
    found: dict[str, dict[Hashable, list[_Key]]] = {}
    for key, topic in channels.items():
        kind = topic.type, topic.encoding, topic.schema_encoding, topic.schema
        found.setdefault(topic.name, {}).setdefault(kind, []).append(key)
    taken = set(found)
    named: dict[_Key, Topic] = {}
    for name, kinds in found.items():
        alike = list(kinds.values()) if len(kinds) == 1 else _alike(channels, list(kinds.values()))
        for keys in alike:
            label = name if len(alike) == 1 else _label(channels[keys[0]], taken)
            taken.add(label)
            named |= {key: replace(channels[keys[0]], name=label, metadata=channels[key].metadata) for key in keys}
    return {key: named[key] for key in channels}


def _alike(channels: Mapping[_Key, Topic], kinds: list[list[_Key]]) -> list[list[_Key]]:
    """Kinds whose definitions differ in words only, such as comments, as one."""
    found: dict[Hashable, list[_Key]] = {}
    for keys in kinds:
        found.setdefault(_contents(channels[keys[0]]), []).extend(keys)
    return list(found.values())


def _contents(topic: Topic) -> Hashable:
    as_written = topic.type, topic.encoding, topic.schema_encoding, topic.schema
    if topic.encoding not in ("cdr", "ros1"):
        return as_written
    try:
        fields = parse_definitions(topic.type, topic.schema.decode(errors="replace"), topic.encoding == "ros1")
    except LogError:
        return as_written
    return short_name(topic.type), topic.encoding, frozenset(fields.items())


def _label(topic: Topic, taken: set[str]) -> str:
    short = re.split(r"[/.]", topic.type)[-1] or topic.encoding or "?"
    label, number = f"{topic.name}({short})", 1
    while label in taken:
        number += 1
        label = f"{topic.name}({short}-{number})"
    return label
