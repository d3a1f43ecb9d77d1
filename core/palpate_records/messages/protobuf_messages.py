"""Protobuf messages in bounded memory: an empty one in another takes two bytes, and perhaps thousands in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate import LogError

from palpate_records.messages.memory_budget import FREE, VALUE, Budget

_MAX_DEPTH = 100  # of messages in messages, as protobuf allows
# Wire types: a number of 1 to 10 bytes, bytes behind their length, numbers of fixed size, and groups.
_VARINT, _COUNTED = 0, 2
_FIXED_SIZES = {1: 8, 5: 4}  # [bytes]
_GROUPS = (3, 4)
_WIRE_BITS = 3  # of a key, below the number of its field
_VARINT_BITS, _MAX_VARINT_BITS = 7, 70  # of each byte; of a number
_PLAIN_TYPES = (1, 2, 6, 7, 9, 12, 15, 16)  # of fields that take as much memory as bytes
_MAX_FACTOR = 8  # memory per byte of the others
_SLOT = 16  # [bytes] of memory of each field of a type, whether a message has it or not: a choice


@dataclass(frozen=True)
class _MessageCost:
    """The memory that messages of a type take."""

    cost: int  # [bytes] of an empty one
    message_fields: Mapping[int, str]  # names of the types of the fields that are messages, by number
    factors: Mapping[int, int]  # memory per byte of the others, by number


def bounded_parser(message: Any) -> Callable[[bytes], Any]:
    """Return a parser of a message class, which raises LogError for a message that would take too much memory."""
    parse: Callable[[bytes], Any] = message.FromString
    name = message.DESCRIPTOR.full_name
    types = _types_within(message.DESCRIPTOR)
    # A message that consists of empty ones has two bytes for each: a smaller one cannot take more than FREE.
    max_safe_size = 2 * FREE // max(message_type.cost for message_type in types.values())  # [bytes]

    def parse_bounded(data: bytes) -> Any:
        """Return a message; raises LogError if it would take too much memory."""
        if len(data) > max_safe_size:
            _charge_message(types, name, memoryview(data), Budget("a message", len(data)), 0)
        return parse(data)

    return parse_bounded


def _types_within(descriptor: Any) -> dict[str, _MessageCost]:
    """Return the type of a descriptor, and those of all messages that it contains, by name."""
    types: dict[str, _MessageCost] = {}
    pending = [descriptor]
    while pending:
        current = pending.pop()
        if current.full_name in types:
            continue
        messages = {field.number: field.message_type for field in current.fields if field.message_type is not None}
        factors = {
            field.number: 1 if field.type in _PLAIN_TYPES else _MAX_FACTOR
            for field in current.fields
            if field.number not in messages
        }
        names = {number: message_type.full_name for number, message_type in messages.items()}
        types[current.full_name] = _MessageCost(VALUE + _SLOT * len(current.fields), names, factors)
        pending += messages.values()
    return types


def _charge_message(types: Mapping[str, _MessageCost], name: str, data: memoryview, budget: Budget, depth: int) -> None:
    """Charge the memory of a message of the type `name`, and of all messages in it, to a budget.

    Damage is left to the parser. Raises LogError beyond the budget, for groups, and for messages nested too deep.
    """
    if depth > _MAX_DEPTH:
        raise LogError(f"its messages are nested more than {_MAX_DEPTH} deep")
    message_type = types[name]
    budget.charge(message_type.cost)
    position = 0
    while position < len(data):
        budget.charge(VALUE)
        key, position = _read_varint(data, position)
        # A key is the number of a field and the wire type of its value.
        number = key >> _WIRE_BITS
        wire_type = key & ((1 << _WIRE_BITS) - 1)
        if wire_type == _COUNTED:
            length, position = _read_varint(data, position)
            if number in message_type.message_fields:
                content = data[position : position + length]
                _charge_message(types, message_type.message_fields[number], content, budget, depth + 1)
            else:
                budget.charge(min(length, len(data)) * message_type.factors.get(number, 1))
            position += length
        elif wire_type == _VARINT:
            _, position = _read_varint(data, position)
        elif wire_type in _GROUPS:
            raise LogError("its groups are not read")
        else:
            position += _FIXED_SIZES.get(wire_type, 0)


def _read_varint(data: memoryview, position: int) -> tuple[int, int]:
    """Return a number of 7 bits a byte, the lowest first, and its end; the last byte lacks the highest bit."""
    value = shift = 0
    while position < len(data) and shift < _MAX_VARINT_BITS:
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << shift
        shift += _VARINT_BITS
        if byte < 0x80:
            break
    return value, position
