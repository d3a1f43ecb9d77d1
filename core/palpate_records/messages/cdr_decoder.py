"""The decoder of messages of ROS, in CDR or as ROS 1 has them: layout by layout, in whole arrays."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from palpate import LogError

from palpate_records.messages.cdr import Excerpt, FieldPlace, MessageLayout, walk, walk_ros1
from palpate_records.messages.definitions import parse_definitions
from palpate_records.messages.memory_budget import FREE, Budget
from palpate_records.messages.readings import SECOND, FieldReading, TopicTable
from palpate_records.messages.topics import Messages, Stamps, Topic

# Choices.
_MAX_LAYOUTS = 64  # of one topic that are kept
_LAYOUT_BYTES = 1024  # [bytes] of layouts per byte of walked messages, in all
_MAX_COMPARISONS = 64  # of the bytes of a block with new layouts, before each message is walked
_NAME_PATH = re.compile(r"(?:^|\.)(?:name\[\d+\]|child_frame_id)$")


class CdrDecoder:
    """Decoder of messages of ROS, by the layouts that are found in them."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        ros1 = topic.encoding == "ros1"
        self._walk = walk_ros1 if ros1 else walk
        self._definitions = parse_definitions(topic.type, topic.schema.decode(errors="replace"), ros1)
        self._layouts: list[MessageLayout] = []
        self._walks = Budget(f"topic {topic.name}", per_byte=_LAYOUT_BYTES)

    def _walk_layout(self, payload: bytes) -> MessageLayout:
        """Return the layout of a message, and charge it to the budget of the topic; raises LogError."""
        layout = self._walk(self._definitions, self._topic.type, payload)
        self._walks.grow(len(payload))
        self._walks.charge(layout.cost)
        return layout

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `MessageDecoder.fields`."""
        layout = self._walk_layout(payload)
        return {path: place.count for path, place in layout.places.items() if place.code != "S"}

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """See `MessageDecoder.texts`."""
        texts = self._walk_layout(payload).texts
        return {path: _decode_text(text) for path, text in texts.items() if not names_a_part(path)}

    def names(self, payload: bytes) -> Collection[str]:
        """See `MessageDecoder.names`."""
        texts = self._walk_layout(payload).texts
        return list(dict.fromkeys(_decode_text(text) for path, text in texts.items() if _NAME_PATH.search(path)))

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """See `MessageDecoder.read`."""
        tables = []
        selecting = [k for k, reading in enumerate(readings) if reading.select is not None]
        for layout, rows, excerpt in self._groups(messages, bool(selecting)):
            # Joints and frames are at other places in each layout.
            resolved = [_resolve(layout, reading) for reading in readings]
            if selecting and all(resolved[k] is None for k in selecting):
                continue
            places = [_place(layout, reading) for reading in resolved]
            stamp_path = _stamp_path(layout, [reading for reading in resolved if reading is not None])
            stamps = None if stamp_path is None else _stamps(layout, excerpt, stamp_path)
            tables.append(TopicTable(rows, excerpt.numbers(places), stamps))
        return _table_in_order(tables, len(readings))

    def _groups(self, messages: Messages, pin: bool) -> Iterator[tuple[MessageLayout, Stamps, Excerpt]]:
        """Yield layouts, the rows of the messages of each, and these messages; raises LogError.

        With `pin`, the names of joints and frames are parts of the layout.
        """
        remaining = np.arange(len(messages))  # rows of messages that have no layout yet
        known_layouts = list(self._layouts)
        # Comparisons of all messages with each new layout are quadratic where hardly two messages are alike.
        allowance = FREE + _MAX_COMPARISONS * int(messages.lengths.sum())  # [bytes]
        while len(remaining):
            is_new = not known_layouts
            layout = self._walk_layout(messages.payload(int(remaining[0]))) if is_new else known_layouts.pop(0)
            pinned = tuple(path for path in layout.texts if _NAME_PATH.search(path)) if pin else ()
            rows = remaining if allowance > 0 else remaining[:1]
            if is_new:
                allowance -= len(rows) * layout.width
            is_alike, excerpt = layout.matches(messages if len(rows) == len(messages) else messages[rows], pinned)
            if is_new:
                if not is_alike[0]:  # it would be walked again and again
                    raise LogError(f"topic {self._topic.name}: a message does not have the topic's layout")
                self._layouts = _latest([layout, *self._layouts])
            if is_alike.any():
                yield layout, rows[is_alike], excerpt
            remaining = remaining[~is_alike] if len(rows) == len(remaining) else remaining[1:]


def _latest(layouts: list[MessageLayout]) -> list[MessageLayout]:
    """Return the layouts that are kept: the first, and as many others as together take little memory."""
    first_layouts = layouts[:_MAX_LAYOUTS]
    while len(first_layouts) > 1 and sum(layout.cost for layout in first_layouts) > FREE:
        first_layouts.pop()
    return first_layouts


_NOWHERE = FieldPlace(0, "S")


def _place(layout: MessageLayout, reading: FieldReading | None) -> tuple[FieldPlace, int | None]:
    """Return place and index of a reading; a place without a number for a reading that a layout does not have."""
    if reading is None:
        return _NOWHERE, None
    return layout.places.get(reading.path, _NOWHERE), reading.index


def _table_in_order(tables: list[TopicTable], width: int) -> TopicTable:
    """Return tables of some rows each as one, in the order of the messages."""
    if len(tables) == 1:
        return tables[0]
    if not tables:
        return TopicTable(np.zeros(0, np.int64), np.zeros((0, width)), None)
    rows = np.concatenate([table.rows for table in tables])
    order = np.argsort(rows)
    stamps = [table.stamps for table in tables if table.stamps is not None]
    return TopicTable(
        rows[order],
        np.concatenate([table.values for table in tables])[order],
        np.concatenate(stamps)[order] if len(stamps) == len(tables) else None,
    )


def names_a_part(path: str) -> bool:
    """Return True if a text only names a frame or a joint."""
    return path.endswith("frame_id") or _NAME_PATH.search(path) is not None


def _decode_text(text: bytes) -> str:
    """Return a text without its closing zero."""
    return text.rstrip(b"\0").decode(errors="replace")


def _resolve(layout: MessageLayout, reading: FieldReading) -> FieldReading | None:
    """Return a reading with the place of its joint or child frame in a layout; None if it is not in it."""
    if reading.select is None:
        return reading
    for path, text in layout.texts.items():
        if _NAME_PATH.search(path) and _decode_text(text) == reading.select:
            if path.startswith("name["):  # of a joint: its number is the index in every array
                return FieldReading(reading.path, int(path[5:-1]))
            # Of a child frame: the reading is in the same element of an array as the name.
            element, dot, _ = path.rpartition(".")
            inner_path = re.sub(r"^\w+(\[\d*\])?\.", "", reading.path) if dot else reading.path
            return FieldReading(f"{element}{dot}{inner_path}", reading.index)
    return None


def _stamps(layout: MessageLayout, excerpt: Excerpt, path: str) -> Stamps:
    """Return the stamps (n,) [ns] at a path."""
    seconds = layout.places[f"{path}.sec"]
    nanoseconds = layout.places[f"{path}.nanosec"]
    stamps: Stamps = excerpt.column(seconds.offset, seconds.code).astype(np.int64) * SECOND
    stamps += excerpt.column(nanoseconds.offset, nanoseconds.code)
    return stamps


def _stamp_path(layout: MessageLayout, readings: Sequence[FieldReading]) -> str | None:
    """Return the path of the stamp of the element that readings are in, else of the message; None without one."""
    elements = [reading.path.rpartition("].")[0] + "]." for reading in readings if "]." in reading.path]
    for path in (*(f"{element}header.stamp" for element in elements), "header.stamp", "stamp"):
        if f"{path}.sec" in layout.places and f"{path}.nanosec" in layout.places:
            return path
    return None
