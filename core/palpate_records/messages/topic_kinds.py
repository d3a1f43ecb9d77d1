"""Topics with several types of messages: every format of logs allows them, and each type needs its own decoder."""

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
    """Return topics with a name for each type of messages: ``/arm(Wrench)`` and ``/arm(Pose)`` if /arm has both.

    `channels` are topics by any key; the result has the same keys.
    """
    keys_by_topic: dict[str, dict[Hashable, list[_Key]]] = {}  # by name, then by type
    for key, topic in channels.items():
        message_type = topic.type, topic.encoding, topic.schema_encoding, topic.schema
        keys_by_topic.setdefault(topic.name, {}).setdefault(message_type, []).append(key)
    names = set(keys_by_topic)
    topics: dict[_Key, Topic] = {}
    for name, keys_by_type in keys_by_topic.items():
        groups = list(keys_by_type.values())
        if len(groups) > 1:
            groups = _groups_of_one_definition(channels, groups)
        for keys in groups:
            label = name if len(groups) == 1 else _unique_name(channels[keys[0]], names)
            names.add(label)
            for key in keys:
                topics[key] = replace(channels[keys[0]], name=label, metadata=channels[key].metadata)
    return {key: topics[key] for key in channels}


def _groups_of_one_definition(channels: Mapping[_Key, Topic], groups: list[list[_Key]]) -> list[list[_Key]]:
    """Return groups of keys whose definitions differ in their text alone, such as comments, as one group."""
    keys_by_fields: dict[Hashable, list[_Key]] = {}
    for keys in groups:
        keys_by_fields.setdefault(_fields_of_topic(channels[keys[0]]), []).extend(keys)
    return list(keys_by_fields.values())


def _fields_of_topic(topic: Topic) -> Hashable:
    """Return the fields that a topic's definition means; the definition itself if it cannot be parsed."""
    definition = topic.type, topic.encoding, topic.schema_encoding, topic.schema
    if topic.encoding not in ("cdr", "ros1"):
        return definition
    try:
        fields = parse_definitions(topic.type, topic.schema.decode(errors="replace"), topic.encoding == "ros1")
    except LogError:
        return definition
    return short_name(topic.type), topic.encoding, frozenset(fields.items())


def _unique_name(topic: Topic, names: set[str]) -> str:
    """Return a topic's name with its type, as in ``/arm(Pose)``, and with a number if that is among the names."""
    type_name = re.split(r"[/.]", topic.type)[-1] or topic.encoding or "?"
    name = f"{topic.name}({type_name})"
    number = 1
    while name in names:
        number += 1
        name = f"{topic.name}({type_name}-{number})"
    return name
