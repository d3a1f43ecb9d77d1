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

_SMALL = 512  # [bytes]
_PADDING = 8  # bytes that a writer may leave at the end of a message
_PLAIN, _LISTS = (0, 1), (2, 3)  # kinds of encapsulation, each big-endian and little-endian
_WIDE = (4, 2)  # bytes of a wide character, of one implementation and another; only one of them fills a message


@dataclass(frozen=True, slots=True)
class FieldPlace:
    """Where a field lies in a message."""

    offset: int
    code: str  # numpy's, with byte order
    count: int | None = None  # elements; None: a plain number


@dataclass(frozen=True)
class MessageLayout:
    """Where everything lies in messages of one shape."""

    size: int
    places: Mapping[str, FieldPlace]  # by path, such as "wrench.force.z"
    texts: Mapping[str, bytes]  # as they stand there, with their closing zero
    lengths: tuple[tuple[int, int], ...]  # offset of a length, and its value
    kind: int | None  # of encapsulation; None: without
    order: str
    cost: int  # [bytes] of memory that the walk was charged

    @property
    def width(self) -> int:
        """How much of a message is compared [bytes]."""
        return min(self.size, _SMALL) + 4 * len(self.lengths)

    def matches(self, messages: Messages, pinned: tuple[str, ...] = ()) -> tuple[NDArray[np.bool_], Excerpt]:
        """(n,) True for messages of this layout, and those; texts in `pinned` must be the same, too."""
        same = messages.lengths == self.size
        excerpt = Excerpt.of(messages if same.all() else messages[same], self.size)
        if not same.any():
            return same, excerpt
        good = np.ones(len(excerpt.messages), bool) if self.kind is None else excerpt.column(1, "u1") == self.kind
        for offset, value in self.lengths:
            good &= excerpt.column(offset, f"{self.order}u4") == value
        for path in pinned:
            raw = np.frombuffer(self.texts[path], np.uint8)
            good &= (excerpt.bytes(self.places[path].offset, len(raw)) == raw).all(axis=1)
        if good.all():
            return same, excerpt
        same[np.flatnonzero(same)[~good]] = False
        return same, excerpt.some(good)


@dataclass(frozen=True)
class Excerpt:
    """Messages of one size: copied side by side where they are small, else left where they are."""

    messages: Messages
    block: Bytes | None

    @classmethod
    def of(cls, messages: Messages, size: int) -> Excerpt:
        """Return the messages, all of a size."""
        return cls(messages, gather(messages.buffer, messages.starts, size) if size <= _SMALL else None)

    def some(self, rows: NDArray[np.bool_]) -> Excerpt:
        """Some of them."""
        return Excerpt(self.messages[rows], None if self.block is None else self.block[rows])

    def column(self, offset: int, code: str) -> NDArray[Any]:
        """(n,) what stands at an offset of each."""
        if self.block is not None:
            return column(self.block, offset, code)
        return column(self.bytes(offset, np.dtype(code).itemsize), 0, code)

    def bytes(self, offset: int, width: int) -> Bytes:
        """(n, width) what stands at an offset of each."""
        if self.block is not None:
            return self.block[:, offset : offset + width]
        return gather(self.messages.buffer, self.messages.starts + offset, width)

    def numbers(self, places: list[tuple[FieldPlace, int | None]]) -> Floats:
        """(n, k) one column for each place and index; NaN where a field has no such element."""
        found = [_at(place, index) for place, index in places]
        if (
            self.block is not None
            and found
            and all(entry == (found[0][0] + 8 * k, "<f8") for k, entry in enumerate(found))
        ):
            begin = found[0][0]  # neighbours, as in every standard message: one copy for all of them
            return np.ascontiguousarray(self.block[:, begin : begin + 8 * len(found)]).view("<f8")
        values = np.full((len(self.messages), len(places)), np.nan)
        for k, (offset, code) in enumerate(found):
            if code:
                values[:, k] = self.column(offset, code)
        return values


def _at(place: FieldPlace, index: int | None) -> tuple[int, str]:
    """Offset and code of a number; no code for anything else."""
    count = 1 if place.count is None else place.count
    if place.code == "S" or (place.count is None) != (index is None) or (index or 0) >= count:
        return 0, ""
    return place.offset + (index or 0) * int(place.code[2]), place.code


def walk(definitions: Definitions, type_name: str, message: bytes) -> MessageLayout:
    """Return the layout of one message; raises LogError where it is not a message of its type."""
    if len(message) < 4 or message[0] != 0:
        raise LogError(f"a message of {type_name} is damaged: it does not begin as CDR")
    if message[1] not in _PLAIN and message[1] not in _LISTS:
        raise LogError(f"a message of {type_name} is in CDR of the kind {message[1]}, which is not read (0 to 3 are)")
    found: list[MessageLayout] = []
    problem: LogError | None = None
    for wide in _WIDE:
        walker = _Walker(definitions, type_name, message, "<" if message[1] % 2 else ">", wide)
        try:
            found.append(_walked(walker, type_name, message))
        except LogError as error:
            problem = problem or error
        if not walker.wide_characters:
            break
    if problem is not None and not found:
        raise problem
    if len(found) > 1 and found[0].places != found[1].places:
        raise LogError(f"a message of {type_name} has wide strings that could be of 2 or of 4 bytes a character")
    return found[0]


def walk_ros1(definitions: Definitions, type_name: str, message: bytes) -> MessageLayout:
    """Return the layout of one message of ROS 1; raises LogError where it is not a message of its type."""
    return _walked(_Walker(definitions, type_name, message, "<", aligned=False), type_name, message)


def _walked(walker: _Walker, type_name: str, message: bytes) -> MessageLayout:
    try:
        walker.message(short_name(type_name), "")
    except (struct.error, _Beyond) as error:
        raise LogError(f"a message of {type_name} is damaged: it ends before its fields do") from error
    left = len(message) - walker.position
    if left > (_PADDING if walker.aligned else 0):
        raise LogError(f"a message of {type_name} is damaged: {left} bytes of it belong to no field")
    # Some writers say parameter list and write none. A real one has 8 bytes more than its fields, at least.
    kind = message[1] if walker.aligned else None
    if left > 3 and (kind in _LISTS or walker.wide_characters):
        raise LogError(f"a message of {type_name} cannot be read: it is a parameter list, or damaged")
    lengths = tuple(walker.lengths)
    return MessageLayout(len(message), walker.places, walker.texts, lengths, kind, walker.order, walker.cost)


class _Beyond(Exception):  # noqa: N818  (a signal, never seen outside)
    """A field would lie beyond the end of the message."""


class _Walker:
    """Goes through a message field by field."""

    def __init__(
        self, definitions: Definitions, type_name: str, data: bytes, order: str, wide: int = 4, aligned: bool = True
    ) -> None:
        self._definitions = definitions
        self._data = data
        self.order = order
        self.aligned = aligned
        self.position = 4 if aligned else 0
        self.places: dict[str, FieldPlace] = {}
        self.texts: dict[str, bytes] = {}
        self.lengths: list[tuple[int, int]] = []
        self.wide_characters = 0
        self._wide = wide  # bytes of a wide character
        self._budget = Budget(f"a message of {type_name}", len(data))

    @property
    def cost(self) -> int:
        """Memory that has been charged [bytes]."""
        return self._budget.spent

    def message(self, type_name: str, prefix: str) -> None:
        fields = self._definitions[type_name]
        if not fields and self.aligned:  # a type without fields takes one byte
            self.position += 1
        for field in fields:
            self._field(field, prefix + field.name)

    def _field(self, field: Field, path: str) -> None:
        count = self._length() if field.count is None else field.count
        if field.type in PRIMITIVES:
            self._budget.charge(ELEMENT + len(path))
            self._numbers(PRIMITIVES[field.type], path, count, field.many)
            return
        if field.many and count > len(self._data) - self.position:  # each element takes a byte, or more
            raise _Beyond
        self._budget.charge(count * (ELEMENT + len(path)))
        for i in range(count):
            name = f"{path}[{i}]" if field.many else path
            if field.type == "string":
                self._text(name)
            elif field.type == "wstring":
                self._wide_text()
            else:
                self.message(field.type, f"{name}.")

    def _align(self, size: int) -> None:
        if self.aligned:
            self.position += -(self.position - 4) % size

    def _length(self) -> int:
        self._align(4)
        (length,) = struct.unpack_from(f"{self.order}I", self._data, self.position)
        self.lengths.append((self.position, length))
        self.position += 4
        return int(length)

    def _numbers(self, code: str, path: str, count: int, many: bool) -> None:
        size = int(code[1])
        if count:
            self._align(size)
        if self.position + count * size > len(self._data):
            raise _Beyond
        self.places[path] = FieldPlace(self.position, self.order + code, count if many else None)
        self.position += count * size

    def _wide_text(self) -> None:
        count = self._length()
        self._align(self._wide if count else 1)
        self.position += count * self._wide
        self.wide_characters += count
        if self.position > len(self._data):
            raise _Beyond

    def _text(self, path: str) -> None:
        length = self._length()
        end = self.position + length
        if end > len(self._data):
            raise _Beyond
        self.places[path] = FieldPlace(self.position, "S", length)
        self.texts[path] = bytes(self._data[self.position : end])
        self.position = end
