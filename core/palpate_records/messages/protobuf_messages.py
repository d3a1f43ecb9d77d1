"""Protobuf messages, of which an empty one within another takes two bytes and may take thousands in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate import LogError

from palpate_records.messages.memory_budget import FREE, VALUE, Budget

_DEPTH = 100  # of messages in messages, as protobuf allows
_VARINT, _COUNTED = 0, 2  # wire types: a number of 1 to 10 bytes; a length, and so many bytes
_FIXED = {1: 8, 5: 4}  # [bytes] of a number by wire type
_GROUPS = (3, 4)
_AS_THEY_ARE = (1, 2, 6, 7, 9, 12, 15, 16)  # types of fields that take as much memory as bytes; others up to 8 times
_SLOT = 16  # [bytes] of memory that each field takes, whether it is there or not


@dataclass(frozen=True)
class _Kind:
    """A type of message."""

    cost: int  # [bytes] of memory of an empty one
    inner: Mapping[int, str]  # types of the fields that are messages, by number
    factors: Mapping[int, int]  # memory of every byte of the others


def bounded_parser(message: Any) -> Callable[[bytes], Any]:
    """Return a parser of a message class that refuses, by LogError, what would take too much memory."""
    parse: Callable[[bytes], Any] = message.FromString
    name = message.DESCRIPTOR.full_name
    kinds = _kinds(message.DESCRIPTOR, {})
    safe = 2 * FREE // max(kind.cost for kind in kinds.values())  # [bytes]: nothing so small can become too much

    def bounded(data: bytes) -> Any:
        if len(data) > safe:
            _weigh(kinds, name, memoryview(data), Budget("a message", len(data)), 0)
        return parse(data)

    return bounded


def _kinds(descriptor: Any, found: dict[str, _Kind]) -> dict[str, _Kind]:
    """Return a type of message, and all that it contains."""
    waiting = [descriptor]
    while waiting:
        one = waiting.pop()
        if one.full_name in found:
            continue
        messages = {field.number: field.message_type for field in one.fields if field.message_type is not None}
        factors = {f.number: 1 if f.type in _AS_THEY_ARE else 8 for f in one.fields if f.number not in messages}
        inner = {number: kind.full_name for number, kind in messages.items()}
        found[one.full_name] = _Kind(VALUE + _SLOT * len(one.fields), inner, factors)
        waiting += messages.values()
    return found


def _weigh(kinds: Mapping[str, _Kind], name: str, data: memoryview, budget: Budget, depth: int) -> None:
    """Charge a message and all that are in it; what is damaged is left to the parser."""
    if depth > _DEPTH:
        raise LogError(f"its messages are nested more than {_DEPTH} deep")
    kind = kinds[name]
    budget.charge(kind.cost)
    at = 0
    while at < len(data):
        budget.charge(VALUE)
        key, at = _varint(data, at)
        number, wire = key >> 3, key & 7
        if wire == _COUNTED:
            length, at = _varint(data, at)
            if number in kind.inner:
                _weigh(kinds, kind.inner[number], data[at : at + length], budget, depth + 1)
            else:
                budget.charge(min(length, len(data)) * kind.factors.get(number, 1))
            at += length
        elif wire == _VARINT:
            _, at = _varint(data, at)
        elif wire in _GROUPS:
            raise LogError("its groups are not read")
        else:
            at += _FIXED.get(wire, 0)


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """Return a number, and where it ends."""
    value = shift = 0
    while at < len(data) and shift < 70:
        byte = data[at]
        at, value, shift = at + 1, value | (byte & 0x7F) << shift, shift + 7
        if byte < 0x80:
            break
    return value, at
