"""Decoders: which one a topic needs."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from palpate import LogError

from palpate_devices.logs.cdr_decoder import CdrDecoder
from palpate_devices.logs.definitions import short_name
from palpate_devices.logs.objects import ObjectDecoder
from palpate_devices.logs.readings import MessageDecoder
from palpate_devices.logs.standard_types import STANDARD_TYPES
from palpate_devices.logs.topics import Topic

# Libraries that decode messages one by one: slower, for what the columnar decoder does not know.
_LIBRARIES = {"mcap_ros2": "mcap-ros2-support", "mcap_ros1": "mcap-ros1-support"}


def decoder_of(topic: Topic) -> MessageDecoder:
    """The decoder of a topic's messages; raises LogError where there is none."""
    try:
        match topic.encoding, topic.schema_encoding:
            case "cdr", "ros2msg" | "":
                return CdrDecoder(topic)
            case "cdr", _ if short_name(topic.type) in STANDARD_TYPES:  # described in IDL, but everybody knows it
                return CdrDecoder(replace(topic, schema=b""))
            case "cdr", "ros2idl":
                return CdrDecoder(topic)
            case "json", _:
                return ObjectDecoder(topic, json.loads)
            case "protobuf", _:
                return ObjectDecoder(topic, _protobuf(topic))
    except LogError as error:
        raise LogError(f"topic {topic.name}: {error}") from error
    load = _library(topic)
    if load is not None:
        return ObjectDecoder(topic, load)
    how = f"{topic.encoding}, described in {topic.schema_encoding or 'nothing'}"
    more = "; ros1 with pip install mcap-ros1-support" if topic.encoding == "ros1" else ""
    raise LogError(
        f"topic {topic.name}: its messages cannot be read ({how}; what can: cdr with ros2msg or ros2idl, json, "
        f"protobuf{more})"
    )


def _library(topic: Topic) -> Callable[[bytes], Any] | None:
    """What an installed library decodes the topic's messages with; None where none does."""
    from mcap.records import Schema

    schema = Schema(1, topic.schema, topic.schema_encoding, topic.type)
    for module in _LIBRARIES:
        try:
            factory = importlib.import_module(f"{module}.decoder").DecoderFactory()
            load: Callable[[bytes], Any] | None = factory.decoder_for(topic.encoding, schema)
        except Exception:  # not installed, or it says in one of many ways that it cannot read the definition
            continue
        if load is not None:
            return load
    return None


def _protobuf(topic: Topic) -> Callable[[bytes], Any]:
    """A parser by the descriptors in the log."""
    try:
        from google.protobuf import (  # type: ignore[import-untyped]
            descriptor_pb2,
            descriptor_pool,
            message_factory,
        )
    except ImportError as error:
        raise LogError("its messages are protobuf: pip install protobuf") from error
    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(topic.schema)
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        message: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.type))
    except Exception as error:  # protobuf raises a dozen kinds on descriptors that are damaged
        raise LogError(f"its protobuf descriptors are damaged: {error}") from error
    parse: Callable[[bytes], Any] = message.FromString
    return parse
