"""Decoders: which one a topic needs; JSON and protobuf, message by message."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import LogError

from palpate_devices.logs.cdr_decoder import CdrDecoder
from palpate_devices.logs.readings import SECOND, Decoder, Reading, Table
from palpate_devices.logs.topics import Messages, Stamps, Topic

_ELEMENTS = 64  # of an array are listed


def decoder_of(topic: Topic) -> Decoder:
    """The decoder of a topic's messages; raises LogError where there is none."""
    try:
        match topic.encoding, topic.schema_encoding:
            case "cdr", "ros2msg" | "":
                return CdrDecoder(topic)
            case "json", _:
                return JsonDecoder(topic)
            case "protobuf", _:
                return ProtobufDecoder(topic)
    except LogError as error:
        raise LogError(f"topic {topic.name}: {error}") from error
    how = f"{topic.encoding}, described in {topic.schema_encoding or 'nothing'}"
    raise LogError(
        f"topic {topic.name}: its messages cannot be read ({how}; what can: cdr with ros2msg, json, protobuf)"
    )


class JsonDecoder:
    """Reads JSON messages; a stamp is an object with sec and nanosec (or nsec), in the header or in `timestamp`."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic

    def _loaded(self, payload: bytes) -> Any:
        try:
            return json.loads(payload)
        except (ValueError, RecursionError) as error:
            raise LogError(f"topic {self._topic.name}: a message is no JSON: {error}") from error

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `Decoder`."""
        found: dict[str, int | None] = {}
        _list_numbers(self._loaded(payload), "", found)
        return found

    def read(self, messages: Messages, readings: Sequence[Reading], select: str | None = None) -> Table:
        """See `Decoder`."""
        _no_selection(self._topic, select)
        objects = [self._loaded(messages.payload(i)) for i in range(len(messages))]
        values = [[_number(_inside(item, str(reading))) for reading in readings] for item in objects]
        stamps = [_json_stamp(item) for item in objects]
        return _table(values, stamps, len(readings))


class ProtobufDecoder:
    """Reads protobuf messages by the descriptors in the log; a stamp is a Timestamp named timestamp or stamp."""

    def __init__(self, topic: Topic) -> None:
        try:
            from google.protobuf import (  # type: ignore[import-untyped]
                descriptor_pb2,
                descriptor_pool,
                message_factory,
            )
        except ImportError as error:
            raise LogError("its messages are protobuf: pip install protobuf") from error
        self._topic = topic
        try:
            files = descriptor_pb2.FileDescriptorSet.FromString(topic.schema)
            pool = descriptor_pool.DescriptorPool()
            for file in files.file:
                pool.Add(file)
            self._message: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.type))
        except Exception as error:  # protobuf raises a dozen kinds on descriptors that are damaged
            raise LogError(f"its protobuf descriptors are damaged: {error}") from error

    def _loaded(self, payload: bytes) -> Any:
        try:
            return self._message.FromString(payload)
        except Exception as error:  # DecodeError, and RuntimeError from the C library
            raise LogError(f"topic {self._topic.name}: a message is damaged: {error}") from error

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `Decoder`."""
        found: dict[str, int | None] = {}
        _list_protobuf(self._loaded(payload), "", found)
        return found

    def read(self, messages: Messages, readings: Sequence[Reading], select: str | None = None) -> Table:
        """See `Decoder`."""
        _no_selection(self._topic, select)
        objects = [self._loaded(messages.payload(i)) for i in range(len(messages))]
        values = [[_number(_inside(item, str(reading))) for reading in readings] for item in objects]
        stamps = [_protobuf_stamp(item) for item in objects]
        return _table(values, stamps, len(readings))


def _no_selection(topic: Topic, select: str | None) -> None:
    if select is not None:
        raise LogError(f"topic {topic.name}: select = {select!r} works for joints and transforms in CDR only")


def _table(values: list[list[float]], stamps: list[int | None], width: int) -> Table:
    known: Stamps | None = None
    if None not in stamps:
        known = np.array(stamps, np.int64)
    table: NDArray[np.float64] = np.array(values, float).reshape(len(values), width)
    return Table(np.arange(len(values)), table, known)


def _inside(item: Any, path: str) -> Any:
    """What a path leads to in nested objects, or None."""
    for name in re.findall(r"[^.\[\]]+", path):
        try:
            if isinstance(item, dict):
                item = item[name]
            elif name.isdigit():
                item = item[int(name)]
            else:
                item = getattr(item, name)
        except (KeyError, IndexError, TypeError, AttributeError):
            return None
    return item


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else math.nan


def _list_numbers(item: Any, prefix: str, found: dict[str, int | None]) -> None:
    if isinstance(item, dict):
        for name, inner in item.items():
            _list_numbers(inner, f"{prefix}.{name}" if prefix else str(name), found)
    elif isinstance(item, list):
        if item and all(isinstance(inner, int | float) for inner in item):
            found[prefix] = len(item)
        else:
            for i, inner in enumerate(item[:_ELEMENTS]):
                _list_numbers(inner, f"{prefix}[{i}]", found)
    elif isinstance(item, int | float):
        found[prefix] = None


def _list_protobuf(message: Any, prefix: str, found: dict[str, int | None], depth: int = 0) -> None:
    for field in message.DESCRIPTOR.fields:
        name, value = f"{prefix}{field.name}", getattr(message, field.name)
        many = hasattr(value, "append") or hasattr(value, "add")
        if field.message_type is not None:
            inner = [(f"{name}[{i}].", v) for i, v in enumerate(value[:_ELEMENTS])] if many else [(f"{name}.", value)]
            for path, item in inner if depth < 16 and not hasattr(value, "keys") else ():
                _list_protobuf(item, path, found, depth + 1)
        elif many and all(isinstance(item, int | float) for item in value):
            found[name] = len(value)
        elif isinstance(value, int | float):
            found[name] = None


def _json_stamp(item: Any) -> int | None:
    for path in ("header.stamp", "timestamp", "stamp"):
        stamp = _inside(item, path)
        if isinstance(stamp, dict):
            rest = stamp.get("nanosec", stamp.get("nsec", stamp.get("nanos")))
            seconds = stamp.get("sec", stamp.get("seconds"))
            if isinstance(seconds, int) and isinstance(rest, int):
                return seconds * SECOND + rest
    return None


def _protobuf_stamp(item: Any) -> int | None:
    for path in ("header.stamp", "timestamp", "stamp"):
        stamp = _inside(item, path)
        if stamp is not None and hasattr(stamp, "nanos"):
            return int(stamp.seconds) * SECOND + int(stamp.nanos)
    return None
