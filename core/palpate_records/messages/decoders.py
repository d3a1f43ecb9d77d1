"""Decoders: which one a topic needs."""

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


def decoder_of(topic: Topic) -> MessageDecoder:
    """Return the decoder of a topic's messages; raises LogError if their format is unknown."""
    try:
        match topic.encoding, topic.schema_encoding:
            case ("cdr", "ros2msg" | "") | ("ros1", "ros1msg"):
                return CdrDecoder(topic)
            case "cdr", _ if short_name(topic.type) in STANDARD_TYPES:  # described in IDL, but everybody knows it
                return CdrDecoder(replace(topic, schema=b""))
            case "cdr", "ros2idl":
                return CdrDecoder(topic)
            case "json", _:
                return ObjectDecoder(topic, _json)
            case "protobuf", _:
                return ObjectDecoder(topic, _protobuf(topic))
    except LogError as error:
        raise LogError(f"topic {topic.name}: {error}") from error
    how = f"{topic.encoding}, described in {topic.schema_encoding or 'nothing'}"
    raise LogError(
        f"topic {topic.name}: its messages cannot be read ({how}; what can: cdr with ros2msg or ros2idl, "
        f"ros1, json, protobuf)"
    )


def _json(message: bytes) -> Any:
    if len(message) * VALUE > FREE:  # smaller ones cannot hold too much
        budget = Budget("a message", len(message))
        budget.charge(VALUE * sum(message.count(mark) for mark in b",[{:"))
    return json.loads(message)


def _protobuf(topic: Topic) -> Callable[[bytes], Any]:
    """Return a parser by the descriptors in the log."""
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
        for file in _in_order(files.file):
            pool.Add(file)
        message: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.type))
    except Exception as error:  # protobuf raises a dozen kinds on descriptors that are damaged
        raise LogError(f"its protobuf descriptors are damaged: {error}") from error
    return bounded_parser(message)


def _in_order(files: Sequence[Any]) -> Iterator[Any]:
    """Descriptors of files, each behind those that it imports; a log may have them in any order."""
    named = {file.name: file for file in files}
    if any(named[file.name] != file for file in files):
        raise LogError("two files in them have one name")
    imports = {name: [other for other in file.dependency if other in named] for name, file in named.items()}
    try:
        return iter([named[name] for name in TopologicalSorter(imports).static_order()])
    except CycleError as error:
        raise LogError(f"{str(error.args[1][0])[:60]!r} imports itself") from error
