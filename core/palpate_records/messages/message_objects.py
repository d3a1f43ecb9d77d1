"""Messages that a library decodes one by one into objects: what a path leads to in them."""

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

_ELEMENTS = 1000  # of an array are listed
_SEPARATORS = 64  # in a path, at which a name with dots or brackets may end
_DEPTH = 16
_LARGEST = 1.7e308
_DIGITS = 40  # characters of a number
_NUMBER = re.compile(r"[-+]?(?:(?:0|[1-9]\d*)(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_STAMPS = ("header.stamp", "timestamp", "stamp")


@dataclass(frozen=True)
class ObjectDecoder:
    """Reads the messages of a topic by a function that makes an object, or nested dictionaries, of each."""

    topic: Topic
    load: Callable[[bytes], Any]

    def _loaded(self, payload: bytes) -> Any:
        try:
            return self.load(payload)
        except Exception as error:  # each library has errors of its own, and those of the C library below it
            how = self.topic.encoding
            kind = BudgetError if isinstance(error, BudgetError) else LogError
            raise kind(f"topic {self.topic.name}: a message is damaged: it is not valid {how}: {error}") from error

    def _budget(self, payload: bytes) -> Budget:
        return Budget(f"a message of topic {self.topic.name}", len(payload))

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `Decoder`."""
        found: dict[str, int | None] = {}
        _list_numbers(self._loaded(payload), "", found, self._budget(payload))
        return found

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """See `Decoder`."""
        found: dict[str, str] = {}
        _list_texts(self._loaded(payload), "", found, self._budget(payload))
        return found

    def names(self, payload: bytes) -> Collection[str]:
        """See `Decoder`."""
        return [name for name, _, _ in _named(self._loaded(payload))]

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """See `Decoder`."""
        rows: list[int] = []
        values: list[list[float]] = []
        stamps: list[int | None] = []
        selecting = [reading for reading in readings if reading.select is not None]
        for row in range(len(messages)):
            item = self._loaded(messages.payload(row))
            places = {name: (path, index) for name, path, index in _named(item)} if selecting else {}
            if selecting and not any(reading.select in places for reading in selecting):
                continue
            paths = [_path(reading, places) for reading in readings]
            rows.append(row)
            values.append([_number(_inside(item, path)) for path in paths])
            stamps.append(_stamp(item, paths))
        known: Stamps | None = None
        if None not in stamps:
            known = np.array(stamps, np.int64)
        table: Floats = np.array(values, float).reshape(len(values), len(readings))
        return TopicTable(np.array(rows, np.int64), table, known)


def _named(item: Any) -> Iterator[tuple[str, str, int | None]]:
    """Joints and child frames: the name, the element they are, or the place that theirs has in every array."""
    names = _inside(item, "name")
    if isinstance(names, Sequence) and not isinstance(names, str | bytes):
        yield from ((str(name), "", i) for i, name in enumerate(names))
    for i, element in enumerate(_items(_inside(item, "transforms"))):
        if isinstance(name := _inside(element, "child_frame_id"), str):
            yield name, f"transforms[{i}]", None
    if isinstance(name := _inside(item, "child_frame_id"), str):
        yield name, "", None


def _path(reading: FieldReading, places: Mapping[str, tuple[str, int | None]]) -> str | None:
    if reading.select is None:
        return str(reading)
    if reading.select not in places:
        return None
    element, index = places[reading.select]
    if index is not None:
        return f"{reading.path}[{index}]"
    return re.sub(r"^transforms(\[\d*\])?", element, str(reading)) if element else str(reading)


def _items(value: Any) -> list[Any]:
    return list(value)[:_ELEMENTS] if isinstance(value, Sequence) and not isinstance(value, str | bytes) else []


def _inside(item: Any, path: str | None) -> Any:
    """What a path leads to in nested objects, or None."""
    if path is None:
        return None
    inner, steps = item, _steps(path)
    if path and not steps:
        return _by_odd_name(item, path)
    for name in steps:
        try:
            if isinstance(inner, dict):
                inner = inner[name]
            elif isinstance(inner, Mapping):  # of protobuf, whose keys may be numbers
                inner = inner[{str(key): key for key in inner}[name]]
            elif name.isdigit():
                inner = inner[int(name)]
            else:
                inner = getattr(inner, name)
        except (KeyError, IndexError, TypeError, AttributeError):
            return _by_odd_name(item, path) if isinstance(item, dict) else None
    return inner


def _by_odd_name(item: Any, path: str) -> Any:
    """What a path leads to where names may have dots or brackets in them, as those of JSON."""
    if not path:
        return item
    if isinstance(item, list):
        match = re.match(r"\[(\d{1,9})\]\.?(.*)", path, re.DOTALL)
        return _by_odd_name(item[int(match[1])], match[2]) if match and int(match[1]) < len(item) else None
    ends = [match.start() for match in islice(re.finditer(r"[.\[]", path), _SEPARATORS)]
    for end in (len(path), *reversed(ends)) if isinstance(item, dict) else ():
        if path[:end] in item:
            found = _by_odd_name(item[path[:end]], path[end:].removeprefix("."))
            if found is not None:
                return found
    return None


@cache
def _steps(path: str) -> tuple[str, ...]:
    return tuple(re.findall(r"[^.\[\]]+", path))


def _number(value: Any) -> float:
    if _is_number(value):
        value = float(value)
    if not isinstance(value, int | float) or abs(value) > _LARGEST:  # an int may have thousands of digits
        return math.nan
    return float(value) if math.isfinite(value) else math.nan


def _stamp(item: Any, paths: Sequence[str | None]) -> int | None:
    """Return the stamp [ns] of the element that is read, else that of the message; None without either."""
    inner = [path.rpartition("].")[0] + "].header.stamp" for path in paths if path and "]." in path]
    for path in (*inner, *_STAMPS):
        stamp = _inside(item, path)
        if stamp is None:
            continue
        for seconds, rest in (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs")):
            whole, part = (int(x) if _is_number(x) and x.isdigit() else x for x in _both(stamp, seconds, rest))
            if isinstance(whole, int) and isinstance(part, int) and abs(whole) < LATEST and abs(part) < LATEST:
                return whole * SECOND + part
    return None


def _both(stamp: Any, seconds: str, rest: str) -> tuple[Any, Any]:
    return _inside(stamp, seconds), _inside(stamp, rest)


def _is_number(value: Any) -> bool:
    """Return True if a value is a number that was written as a text, as JSON has those of 64 bits; none begins with
    00."""
    return isinstance(value, str) and len(value) < _DIGITS and _NUMBER.fullmatch(value) is not None


def _list_numbers(item: Any, prefix: str, found: dict[str, int | None], budget: Budget, depth: int = 0) -> None:
    budget.charge(ELEMENT + len(prefix))
    if isinstance(item, int | float) or (_is_number(item) and not prefix.endswith("frame_id")):
        found[prefix] = None
    elif isinstance(item, str) or depth > _DEPTH:
        return
    elif isinstance(item, bytes | bytearray | memoryview):
        found[prefix] = len(item)
    elif isinstance(item, Mapping):
        for name, inner in item.items():
            _list_numbers(inner, f"{prefix}.{name}" if prefix else str(name), found, budget, depth + 1)
    elif hasattr(item, "__len__") and hasattr(item, "__getitem__"):
        if len(item) and all(isinstance(inner, int | float) or _is_number(inner) for inner in item):
            found[prefix] = len(item)
        else:
            for i, inner in enumerate(item[:_ELEMENTS]):
                _list_numbers(inner, f"{prefix}[{i}]", found, budget, depth + 1)
    else:
        for name in _attributes(item):
            _list_numbers(getattr(item, name), f"{prefix}.{name}" if prefix else name, found, budget, depth + 1)


def _attributes(item: Any) -> list[str]:
    """Return the fields of a decoded message: of protobuf by its descriptor, of others by its slots or attributes."""
    if hasattr(item, "DESCRIPTOR"):
        return [field.name for field in item.DESCRIPTOR.fields]
    names = getattr(item, "__slots__", None) or list(getattr(item, "__dict__", ()))
    return [name for name in names if not name.startswith("_")]


def _list_texts(item: Any, prefix: str, found: dict[str, str], budget: Budget, depth: int = 0) -> None:
    """Texts of a message by their paths, but for those that only name a frame, joints or elements."""
    budget.charge(ELEMENT + len(prefix))
    if isinstance(item, str):
        if not prefix.endswith("frame_id") and not _is_number(item):
            found[prefix] = item
    elif isinstance(item, Mapping) and depth <= _DEPTH:
        for name, inner in item.items():
            _list_texts(inner, f"{prefix}.{name}" if prefix else str(name), found, budget, depth + 1)
    elif depth <= _DEPTH and not isinstance(item, int | float | bytes | bytearray | memoryview | list | tuple):
        for name in _attributes(item) if item is not None else ():
            _list_texts(getattr(item, name), f"{prefix}.{name}" if prefix else name, found, budget, depth + 1)
