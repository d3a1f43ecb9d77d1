"""The choice of the decoder of a topic."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import Any

from palpate import LogError

from palpate_records.messages.cdr_decoder import CdrDecoder
from palpate_records.messages.definitions import TEXT_LIMIT, short_name
from palpate_records.messages.memory_budget import FREE, VALUE, Budget
from palpate_records.messages.message_objects import ObjectDecoder
from palpate_records.messages.protobuf_messages import bounded_parser
from palpate_records.messages.readings import MessageDecoder
from palpate_records.messages.standard_types import STANDARD_TYPES
from palpate_records.messages.topics import Topic

_MAX_SHOWN = 60  # characters of a name in a message: a choice


def decoder_of(topic: Topic) -> MessageDecoder:
    """Return the decoder of a topic's messages; raises LogError if their format is unknown."""
    try:
        match topic.encoding, topic.schema_encoding:
            case ("cdr", "ros2msg" | "") | ("ros1", "ros1msg"):
                return CdrDecoder(topic)
            case "cdr", _ if short_name(topic.type) in STANDARD_TYPES:  # of any description, which is not needed
                return CdrDecoder(replace(topic, schema=b""))
            case "cdr", "ros2idl":
                return CdrDecoder(topic)
            case "json", _:
                return ObjectDecoder(topic, _load_json)
            case "protobuf", _:
                return ObjectDecoder(topic, _protobuf_parser(topic))
    except LogError as error:
        raise LogError(f"topic {topic.name}: {error}") from error
    description = f"{topic.encoding}, described in {topic.schema_encoding or 'nothing'}"
    raise LogError(
        f"topic {topic.name}: its messages cannot be read ({description}; what can: cdr with ros2msg or ros2idl, "
        f"ros1, json, protobuf)"
    )


def _load_json(message: bytes) -> Any:
    """Return a document of JSON; raises BudgetError for one whose values would take too much memory."""
    if len(message) * VALUE > FREE:  # a smaller one cannot
        budget = Budget("a message", len(message))
        budget.charge(VALUE * sum(message.count(mark) for mark in b",[{:"))
    return json.loads(message)


def _protobuf_parser(topic: Topic) -> Callable[[bytes], Any]:
    """Return a parser of messages by the descriptors in the log; raises LogError."""
    try:
        from google.protobuf import (  # type: ignore[import-untyped]
            descriptor_pb2,
            descriptor_pool,
            message_factory,
        )
    except ImportError as error:
        raise LogError("its messages are protobuf: pip install protobuf") from error
    if len(topic.schema) > TEXT_LIMIT:
        raise LogError(f"its protobuf descriptors have {len(topic.schema)} bytes; more than {TEXT_LIMIT} is damage")
    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(topic.schema)
        pool = descriptor_pool.DescriptorPool()
        for file in _files_in_order(files.file):
            pool.Add(file)
        message: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.type))
    except Exception as error:  # protobuf raises errors of many classes for damaged descriptors
        raise LogError(f"its protobuf descriptors are damaged: {error}") from error
    return bounded_parser(message)


def _files_in_order(files: Sequence[Any]) -> Iterator[Any]:
    """Return descriptors of files, each after those that it imports; a log may have them in any order.

    Raises LogError for two different files of one name, and for one that imports itself.
    """
    by_name = {file.name: file for file in files}
    if any(by_name[file.name] != file for file in files):
        raise LogError("two files in them have one name")
    imports = {name: [other for other in file.dependency if other in by_name] for name, file in by_name.items()}
    try:
        return iter([by_name[name] for name in TopologicalSorter(imports).static_order()])
    except CycleError as error:
        raise LogError(f"{str(error.args[1][0])[:_MAX_SHOWN]!r} imports itself") from error
