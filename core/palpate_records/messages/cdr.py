"""Messages of any ROS 2 type (CDR) and of any ROS 1 type, into columns.

Where a field of a message lies depends on the lengths of the strings and sequences before it. One message is walked
field by field; every other message of the same length, whose strings and sequences have the same lengths, has the same
layout and is read with it in whole arrays. A topic whose layout varies costs one walk for each layout.

Encapsulation of CDR: 4 bytes, the second of which is odd for little-endian; alignment counts from byte 4. A message of
ROS 1 has none, is little-endian and aligns nothing.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

from palpate_records.messages.definitions import PRIMITIVES, Definitions, Field, short_name
from palpate_records.messages.memory_budget import ELEMENT, Budget
from palpate_records.messages.topics import Bytes, Messages, column, gather

_MAX_COPY = 512  # [bytes] of a message that is copied next to others: a choice
_MAX_PADDING = 8  # [bytes] that a writer may leave at the end of a message: a choice
_ENCAPSULATION_SIZE = 4  # [bytes]
_LENGTH_SIZE = 4  # [bytes] of the length of a string or sequence
_NUMBER_SIZE = 8  # [bytes] of float64
_PLAIN, _LISTS = (0, 1), (2, 3)  # kinds of encapsulation, each big-endian and little-endian
_WIDE_SIZES = (4, 2)  # [bytes] of a wide character, of one implementation and another; only one fills a message


@dataclass(frozen=True, slots=True)
class FieldPlace:
    """The place of a field in a message."""

    offset: int
    code: str  # numpy's, with byte order
    count: int | None = None  # elements; None: a plain number


@dataclass(frozen=True)
class MessageLayout:
    """The places of all fields in messages of one shape."""

    size: int
    places: Mapping[str, FieldPlace]  # by path, such as "wrench.force.z"
    texts: Mapping[str, bytes]  # by path, with their closing zero
    lengths: tuple[tuple[int, int], ...]  # offset of a length, and its value
    kind: int | None  # of encapsulation; None without one
    order: str
    cost: int  # [bytes] of memory that the walk took

    @property
    def width(self) -> int:
        """Size [bytes] of the part of a message that a comparison reads."""
        return min(self.size, _MAX_COPY) + _LENGTH_SIZE * len(self.lengths)

    def matches(self, messages: Messages, pinned: tuple[str, ...] = ()) -> tuple[NDArray[np.bool_], Excerpt]:
        """Return True (n,) for messages of this layout, and an excerpt of these.

        A message has the layout if its size, its encapsulation, and the lengths of its strings and sequences are the
        same; texts at the paths in `pinned`, such as names of joints, must be the same as well.
        """
        is_alike = messages.lengths == self.size
        excerpt = Excerpt.of(messages if is_alike.all() else messages[is_alike], self.size)
        if not is_alike.any():
            return is_alike, excerpt
        # Encapsulation, lengths and pinned texts of the messages that have the size of this layout.
        rows = np.ones(len(excerpt.messages), bool) if self.kind is None else excerpt.column(1, "u1") == self.kind
        for offset, length in self.lengths:
            rows &= excerpt.column(offset, f"{self.order}u4") == length
        for path in pinned:
            text = np.frombuffer(self.texts[path], np.uint8)
            rows &= (excerpt.bytes(self.places[path].offset, len(text)) == text).all(axis=1)
        if rows.all():
            return is_alike, excerpt
        is_alike[np.flatnonzero(is_alike)[~rows]] = False
        return is_alike, excerpt.some(rows)


@dataclass(frozen=True)
class Excerpt:
    """Messages of one size; small ones are copied side by side."""

    messages: Messages
    block: Bytes | None  # (n, size) the copies; None for large messages

    @classmethod
    def of(cls, messages: Messages, size: int) -> Excerpt:
        """Return messages that all have a size [bytes]."""
        return cls(messages, gather(messages.buffer, messages.starts, size) if size <= _MAX_COPY else None)

    def some(self, rows: NDArray[np.bool_]) -> Excerpt:
        """Return some rows of the messages."""
        return Excerpt(self.messages[rows], None if self.block is None else self.block[rows])

    def column(self, offset: int, code: str) -> NDArray[Any]:
        """Return the numbers (n,) at an offset of each message, by numpy's code."""
        if self.block is not None:
            return column(self.block, offset, code)
        return column(self.bytes(offset, np.dtype(code).itemsize), 0, code)

    def bytes(self, offset: int, width: int) -> Bytes:
        """Return the bytes (n, width) at an offset of each message."""
        if self.block is not None:
            return self.block[:, offset : offset + width]
        return gather(self.messages.buffer, self.messages.starts + offset, width)

    def numbers(self, places: list[tuple[FieldPlace, int | None]]) -> Floats:
        """Return a column (n, k) for each place and index; NaN for an element that a field does not have."""
        elements = [_element(place, index) for place, index in places]
        first_offset = elements[0][0] if elements else 0
        are_neighbours = all(element == (first_offset + _NUMBER_SIZE * k, "<f8") for k, element in enumerate(elements))
        if self.block is not None and elements and are_neighbours:  # as in every standard message: a single copy
            end = first_offset + _NUMBER_SIZE * len(elements)
            return np.ascontiguousarray(self.block[:, first_offset:end]).view("<f8")
        values = np.full((len(self.messages), len(places)), np.nan)
        for k, (offset, code) in enumerate(elements):
            if code:
                values[:, k] = self.column(offset, code)
        return values


def _element(place: FieldPlace, index: int | None) -> tuple[int, str]:
    """Return offset and numpy's code of a number; no code for a text, and for an element that is not there."""
    count = 1 if place.count is None else place.count
    if place.code == "S" or (place.count is None) != (index is None) or (index or 0) >= count:
        return 0, ""
    return place.offset + (index or 0) * int(place.code[2]), place.code


def walk(definitions: Definitions, type_name: str, message: bytes) -> MessageLayout:
    """Return the layout of one message; raises LogError if it is not a message of its type.

    `definitions` are the fields of all types of messages that a message may contain.
    """
    _check_encapsulation(type_name, message)
    # Wide characters have one of two sizes, and mostly only one of them fills the message.
    layouts: list[MessageLayout] = []
    first_error: LogError | None = None
    order = "<" if message[1] % 2 else ">"  # an odd encapsulation is little-endian
    for wide_size in _WIDE_SIZES:
        walker = _Walker(definitions, type_name, message, order, wide_size)
        try:
            layouts.append(_layout_of_walk(walker, type_name, message))
        except LogError as error:
            first_error = first_error or error
        if not walker.wide_characters:
            break
    if first_error is not None and not layouts:
        raise first_error
    if len(layouts) > 1 and layouts[0].places != layouts[1].places:
        raise LogError(f"a message of {type_name} has wide strings that could be of 2 or of 4 bytes a character")
    return layouts[0]


def _check_encapsulation(type_name: str, message: bytes) -> None:
    """Raise LogError for a message that does not begin as CDR of a kind that is read."""
    if len(message) < _ENCAPSULATION_SIZE or message[0] != 0:
        raise LogError(f"a message of {type_name} is damaged: it does not begin as CDR")
    if message[1] not in _PLAIN and message[1] not in _LISTS:
        raise LogError(f"a message of {type_name} is in CDR of the kind {message[1]}, which is not read (0 to 3 are)")


def walk_ros1(definitions: Definitions, type_name: str, message: bytes) -> MessageLayout:
    """Return the layout of one message of ROS 1; raises LogError if it is not a message of its type."""
    return _layout_of_walk(_Walker(definitions, type_name, message, "<", aligned=False), type_name, message)


def _layout_of_walk(walker: _Walker, type_name: str, message: bytes) -> MessageLayout:
    """Walk through a message and return its layout; raises LogError if its fields do not fill it."""
    try:
        walker.walk_message(short_name(type_name), "")
    except (struct.error, _BeyondError) as error:
        raise LogError(f"a message of {type_name} is damaged: it ends before its fields do") from error
    rest_size = len(message) - walker.position
    if rest_size > (_MAX_PADDING if walker.aligned else 0):
        raise LogError(f"a message of {type_name} is damaged: {rest_size} bytes of it belong to no field")
    # Some writers declare a parameter list and write plain fields. A real list has 8 bytes more than its fields; a rest
    # of 3 bytes is less than the head of one parameter.
    kind = message[1] if walker.aligned else None
    if rest_size > 3 and (kind in _LISTS or walker.wide_characters):
        raise LogError(f"a message of {type_name} cannot be read: it is a parameter list, or damaged")
    return MessageLayout(
        size=len(message),
        places=walker.places,
        texts=walker.texts,
        lengths=tuple(walker.lengths),
        kind=kind,
        order=walker.order,
        cost=walker.cost,
    )


class _BeyondError(Exception):
    """A field beyond the end of the message; never raised to a caller."""


class _Walker:
    """A walk through a message, field by field."""

    def __init__(
        self,
        definitions: Definitions,
        type_name: str,
        data: bytes,
        order: str,
        wide_size: int = _WIDE_SIZES[0],
        aligned: bool = True,
    ) -> None:
        """Begin a walk through a message (`data`): its byte `order` is "<" or ">"; only CDR is `aligned`."""
        self._definitions = definitions
        self._data = data
        self.order = order
        self.aligned = aligned
        self.position = _ENCAPSULATION_SIZE if aligned else 0
        self.places: dict[str, FieldPlace] = {}
        self.texts: dict[str, bytes] = {}
        self.lengths: list[tuple[int, int]] = []
        self.wide_characters = 0
        self._wide_size = wide_size  # [bytes] of a wide character
        self._budget = Budget(f"a message of {type_name}", len(data))

    @property
    def cost(self) -> int:
        """Memory that the walk took [bytes]."""
        return self._budget.spent

    def walk_message(self, type_name: str, prefix: str) -> None:
        """Walk through the fields of a type, whose paths begin with a prefix; raises LogError and _BeyondError."""
        fields = self._definitions[type_name]
        if not fields and self.aligned:  # a type without fields takes one byte
            self.position += 1
        for field in fields:
            self._walk_field(field, prefix + field.name)

    def _walk_field(self, field: Field, path: str) -> None:
        """Walk through a number, a text, a message, or an array of them, whose place has a path such as "pose.x"."""
        count = self._read_length() if field.count is None else field.count
        if field.type in PRIMITIVES:
            self._budget.charge(ELEMENT + len(path))
            self._walk_numbers(PRIMITIVES[field.type], path, count, field.many)
            return
        if field.many and count > len(self._data) - self.position:  # each element takes at least a byte
            raise _BeyondError
        self._budget.charge(count * (ELEMENT + len(path)))
        for i in range(count):
            name = f"{path}[{i}]" if field.many else path
            if field.type == "string":
                self._walk_text(name)
            elif field.type == "wstring":
                self._walk_wide_text()
            else:
                self.walk_message(field.type, f"{name}.")

    def _align(self, size: int) -> None:
        """Move to a multiple of a size [bytes], counted from the end of the encapsulation."""
        if self.aligned:
            self.position += -(self.position - _ENCAPSULATION_SIZE) % size

    def _read_length(self) -> int:
        """Return the length of a string or sequence, and note its place."""
        self._align(_LENGTH_SIZE)
        (length,) = struct.unpack_from(f"{self.order}I", self._data, self.position)
        self.lengths.append((self.position, length))
        self.position += _LENGTH_SIZE
        return int(length)

    def _walk_numbers(self, code: str, path: str, count: int, many: bool) -> None:
        """Note the place of a number or an array; an empty one is not aligned."""
        size = int(code[1])
        if count:
            self._align(size)
        if self.position + count * size > len(self._data):
            raise _BeyondError
        self.places[path] = FieldPlace(self.position, self.order + code, count if many else None)
        self.position += count * size

    def _walk_wide_text(self) -> None:
        """Skip a text of wide characters."""
        count = self._read_length()
        self._align(self._wide_size if count else 1)
        self.position += count * self._wide_size
        self.wide_characters += count
        if self.position > len(self._data):
            raise _BeyondError

    def _walk_text(self, path: str) -> None:
        """Note a text and its place."""
        length = self._read_length()
        end = self.position + length
        if end > len(self._data):
            raise _BeyondError
        self.places[path] = FieldPlace(self.position, "S", length)
        self.texts[path] = bytes(self._data[self.position : end])
        self.position = end
