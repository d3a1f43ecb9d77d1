"""Messages that a library decodes one by one into objects, in which paths lead to numbers and texts."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
from palpate import Floats, LogError

from palpate_records.messages.memory_budget import ELEMENT, Budget, BudgetError
from palpate_records.messages.readings import LATEST, SECOND, FieldReading, TopicTable
from palpate_records.messages.topics import Messages, Stamps, Topic

_MAX_ELEMENTS = 1000  # of an array that are listed: a choice
_MAX_SEPARATORS = 64  # in a path, at which a name with dots or brackets may end: a choice
_WITHOUT_TEXTS = (int, float, bytes, bytearray, memoryview, list, tuple)  # types whose elements are not listed as texts
_MAX_DEPTH = 16  # of objects within objects: a choice
_MAX_NUMBER = 1.7e308  # nearly the largest double
_MAX_DIGITS = 40  # characters of a number that is written as a text: a choice
_NUMBER = re.compile(r"[-+]?(?:(?:0|[1-9]\d*)(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_STAMP_PATHS = ("header.stamp", "timestamp", "stamp")
_STAMP_NAMES = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs"))


@dataclass(frozen=True)
class ObjectDecoder:
    """Decoder of a topic by a function that makes an object, or nested dictionaries, of each message."""

    topic: Topic
    load: Callable[[bytes], Any]

    def _load(self, payload: bytes) -> Any:
        """Return the object of a message; raises LogError."""
        try:
            return self.load(payload)
        except Exception as error:  # each library has errors of its own, and those of the C library below it
            error_class = BudgetError if isinstance(error, BudgetError) else LogError
            raise error_class(
                f"topic {self.topic.name}: a message is damaged: it is not valid {self.topic.encoding}: {error}"
            ) from error

    def _budget(self, payload: bytes) -> Budget:
        """Return the budget of a message."""
        return Budget(f"a message of topic {self.topic.name}", len(payload))

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `MessageDecoder.fields`."""
        counts: dict[str, int | None] = {}
        _list_numbers(self._load(payload), "", counts, self._budget(payload))
        return counts

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """See `MessageDecoder.texts`."""
        texts: dict[str, str] = {}
        _list_texts(self._load(payload), "", texts, self._budget(payload))
        return texts

    def names(self, payload: bytes) -> Collection[str]:
        """See `MessageDecoder.names`."""
        return [name for name, _, _ in _named_parts(self._load(payload))]

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """Return the numbers of some readings (fields) of messages, one row for each; see `MessageDecoder.read`.

        With readings of a joint or frame by name, only messages that have one of the names.
        """
        rows: list[int] = []
        values: list[list[float]] = []
        stamps: list[int | None] = []
        selected_names = [reading.select for reading in readings if reading.select is not None]
        for row in range(len(messages)):
            item = self._load(messages.payload(row))
            places = {name: (path, index) for name, path, index in _named_parts(item)} if selected_names else {}
            if selected_names and not any(name in places for name in selected_names):
                continue
            paths = [_path_in_message(reading, places) for reading in readings]
            rows.append(row)
            values.append([_finite_number(_value_at(item, path)) for path in paths])
            stamps.append(_stamp(item, paths))
        table: Floats = np.array(values, float).reshape(len(values), len(readings))
        stamp_column: Stamps | None = None if None in stamps else np.array(stamps, np.int64)
        return TopicTable(np.array(rows, np.int64), table, stamp_column)


def _named_parts(item: Any) -> Iterator[tuple[str, str, int | None]]:
    """Yield the joints and child frames of a message: name, path of its element, and its index in every array."""
    names = _value_at(item, "name")
    if isinstance(names, Sequence) and not isinstance(names, str | bytes):
        yield from ((str(name), "", i) for i, name in enumerate(names))
    for i, element in enumerate(_items(_value_at(item, "transforms"))):
        if isinstance(name := _value_at(element, "child_frame_id"), str):
            yield name, f"transforms[{i}]", None
    if isinstance(name := _value_at(item, "child_frame_id"), str):
        yield name, "", None


def _path_in_message(reading: FieldReading, places: Mapping[str, tuple[str, int | None]]) -> str | None:
    """Return the path of a reading, in the element of its joint or child frame; None if the message lacks that."""
    if reading.select is None:
        return str(reading)
    if reading.select not in places:
        return None
    element, index = places[reading.select]
    if index is not None:
        return f"{reading.path}[{index}]"
    return re.sub(r"^transforms(\[\d*\])?", element, str(reading)) if element else str(reading)


def _items(value: Any) -> list[Any]:
    """Return the first elements of a sequence; none of anything else."""
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        return []
    return list(value)[:_MAX_ELEMENTS]


def _value_at(item: Any, path: str | None) -> Any:
    """Return the value at a path in nested objects; None without one.

    `item` is a message as an object, or as nested dictionaries and lists.
    """
    if path is None:
        return None
    inner = item
    steps = _steps(path)
    if path and not steps:
        return _value_by_odd_name(item, path)
    for name in steps:
        try:
            if isinstance(inner, dict):
                inner = inner[name]
            elif isinstance(inner, Mapping):  # a map of protobuf, whose keys may be numbers
                inner = inner[{str(key): key for key in inner}[name]]
            elif name.isdigit():
                inner = inner[int(name)]
            else:
                inner = getattr(inner, name)
        except (KeyError, IndexError, TypeError, AttributeError):
            return _value_by_odd_name(item, path) if isinstance(item, dict) else None
    return inner


def _value_by_odd_name(item: Any, path: str) -> Any:
    """Return the value at a path whose names may have dots or brackets in them, as those of JSON; None without one.

    `item` is a part of a message: a dictionary, a list, or a value.
    """
    if not path:
        return item
    if isinstance(item, list):
        match = re.match(r"\[(\d{1,9})\]\.?(.*)", path, re.DOTALL)
        if match is None or int(match[1]) >= len(item):
            return None
        return _value_by_odd_name(item[int(match[1])], match[2])
    if not isinstance(item, dict):
        return None
    # The name may end at any separator; the longest name that leads to a value counts.
    ends = [match.start() for match in islice(re.finditer(r"[.\[]", path), _MAX_SEPARATORS)]
    for end in (len(path), *reversed(ends)):
        if path[:end] in item:
            value = _value_by_odd_name(item[path[:end]], path[end:].removeprefix("."))
            if value is not None:
                return value
    return None


@cache
def _steps(path: str) -> tuple[str, ...]:
    """Return the names and indices in a path."""
    return tuple(re.findall(r"[^.\[\]]+", path))


def _finite_number(value: Any) -> float:
    """Return a number, also one that is written as a text; NaN for anything else."""
    if _is_number_text(value):
        value = float(value)
    if not isinstance(value, int | float) or abs(value) > _MAX_NUMBER:  # an integer may have thousands of digits
        return math.nan
    return float(value) if math.isfinite(value) else math.nan


def _stamp(item: Any, paths: Sequence[str | None]) -> int | None:
    """Return the stamp [ns] of the element that is read, else that of the message; None without either."""
    element_paths = [path.rpartition("].")[0] + "].header.stamp" for path in paths if path and "]." in path]
    for path in (*element_paths, *_STAMP_PATHS):
        stamp = _value_at(item, path)
        if stamp is None:
            continue
        for seconds_name, nanoseconds_name in _STAMP_NAMES:
            seconds = _whole_number(_value_at(stamp, seconds_name))
            nanoseconds = _whole_number(_value_at(stamp, nanoseconds_name))
            if seconds is not None and nanoseconds is not None:
                return seconds * SECOND + nanoseconds
    return None


def _whole_number(value: Any) -> int | None:
    """Return a part of a stamp, also one that is written as a text; None for anything else, and beyond the latest."""
    if _is_number_text(value) and value.isdigit():
        value = int(value)
    return value if isinstance(value, int) and abs(value) < LATEST else None


def _is_number_text(value: Any) -> bool:
    """Return True for a number that is written as a text, as JSON has those of 64 bits; not for one such as "007"."""
    return isinstance(value, str) and len(value) < _MAX_DIGITS and _NUMBER.fullmatch(value) is not None


def _list_numbers(item: Any, prefix: str, counts: dict[str, int | None], budget: Budget, depth: int = 0) -> None:
    """Add the numbers of an object to `counts` by path: None for one, else how many elements an array has.

    `prefix` is the path of the object. The memory of the paths is charged to a budget, which raises LogError.
    """
    budget.charge(ELEMENT + len(prefix))
    if isinstance(item, int | float) or (_is_number_text(item) and not prefix.endswith("frame_id")):
        counts[prefix] = None
    elif isinstance(item, str) or depth > _MAX_DEPTH:
        return
    elif isinstance(item, bytes | bytearray | memoryview) or _is_number_array(item):
        counts[prefix] = len(item)
    elif _is_array(item):
        for i, element in enumerate(item[:_MAX_ELEMENTS]):
            _list_numbers(element, f"{prefix}[{i}]", counts, budget, depth + 1)
    else:
        for path, member in _members(item, prefix):
            _list_numbers(member, path, counts, budget, depth + 1)


def _is_array(item: Any) -> bool:
    """Return True for an object with elements that is not a map."""
    return not isinstance(item, Mapping) and hasattr(item, "__len__") and hasattr(item, "__getitem__")


def _is_number_array(item: Any) -> bool:
    """Return True for an array of numbers alone, and at least one."""
    if not _is_array(item) or not len(item):
        return False
    return all(isinstance(element, int | float) or _is_number_text(element) for element in item)


def _members(item: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield path and value of each entry of a map, or of each field of a message."""
    if isinstance(item, Mapping):
        for key, value in item.items():
            yield (f"{prefix}.{key}" if prefix else str(key)), value
    else:
        for name in _attributes(item):
            yield (f"{prefix}.{name}" if prefix else name), getattr(item, name)


def _attributes(item: Any) -> list[str]:
    """Return the fields of a decoded message: of protobuf by its descriptor, of others by its slots or attributes."""
    if hasattr(item, "DESCRIPTOR"):
        return [field.name for field in item.DESCRIPTOR.fields]
    names = getattr(item, "__slots__", None) or list(getattr(item, "__dict__", ()))
    return [name for name in names if not name.startswith("_")]


def _list_texts(item: Any, prefix: str, texts: dict[str, str], budget: Budget, depth: int = 0) -> None:
    """Add the texts of an object to `texts` by path, without those that only name a frame, joints or elements."""
    budget.charge(ELEMENT + len(prefix))
    if isinstance(item, str):
        if not prefix.endswith("frame_id") and not _is_number_text(item):
            texts[prefix] = item
    elif depth <= _MAX_DEPTH and not isinstance(item, _WITHOUT_TEXTS):
        for path, member in _members(item, prefix):
            _list_texts(member, path, texts, budget, depth + 1)
