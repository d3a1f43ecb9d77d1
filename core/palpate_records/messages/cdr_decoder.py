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

_LAYOUTS = 64  # layouts of one topic that are kept
_WALKS = 1024  # [bytes] of layouts for every byte of messages that have been walked, all in all
_COMPARED = 64  # how many times the bytes of a block are compared with new layouts, before each message is walked
_NAMES = re.compile(r"(?:^|\.)(?:name\[\d+\]|child_frame_id)$")


class CdrDecoder:
    """Reads messages of ROS by the layouts that they turn out to have."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        ros1 = topic.encoding == "ros1"
        self._walk = walk_ros1 if ros1 else walk
        self._definitions = parse_definitions(topic.type, topic.schema.decode(errors="replace"), ros1)
        self._layouts: list[MessageLayout] = []
        self._walks = Budget(f"topic {topic.name}", per_byte=_WALKS)

    def _walked(self, payload: bytes) -> MessageLayout:
        layout = self._walk(self._definitions, self._topic.type, payload)
        self._walks.grow(len(payload))
        self._walks.charge(layout.cost)
        return layout

    def fields(self, payload: bytes) -> Mapping[str, int | None]:
        """See `Decoder`."""
        layout = self._walked(payload)
        return {path: place.count for path, place in layout.places.items() if place.code != "S"}

    def texts(self, payload: bytes) -> Mapping[str, str]:
        """See `Decoder`."""
        texts = self._walked(payload).texts
        return {path: _words(text) for path, text in texts.items() if not names_a_part(path)}

    def names(self, payload: bytes) -> Collection[str]:
        """See `Decoder`."""
        texts = self._walked(payload).texts
        found = [_words(text) for path, text in texts.items() if _NAMES.search(path)]
        return list(dict.fromkeys(found))

    def read(self, messages: Messages, readings: Sequence[FieldReading]) -> TopicTable:
        """See `Decoder`."""
        tables = []
        selecting = [k for k, reading in enumerate(readings) if reading.select is not None]
        for layout, rows, excerpt in self._groups(messages, bool(selecting)):
            found = [_resolved(layout, reading) for reading in readings]
            if selecting and all(found[k] is None for k in selecting):
                continue
            places = [_place(layout, reading) for reading in found]
            stamp = _stamp_path(layout, [reading for reading in found if reading is not None])
            stamps = None
            if stamp is not None:
                seconds, rest = (layout.places[f"{stamp}.{part}"] for part in ("sec", "nanosec"))
                stamps = excerpt.column(seconds.offset, seconds.code).astype(np.int64) * SECOND
                stamps += excerpt.column(rest.offset, rest.code)
            tables.append(TopicTable(rows, excerpt.numbers(places), stamps))
        return _in_order(tables, len(readings))

    def _groups(self, messages: Messages, pin: bool) -> Iterator[tuple[MessageLayout, Stamps, Excerpt]]:
        """Layouts, the rows of the messages that have each, and those messages."""
        left = np.arange(len(messages))
        known = list(self._layouts)
        patience = FREE + _COMPARED * int(messages.lengths.sum())  # [bytes]
        while len(left):
            fresh = not known
            layout = self._walked(messages.payload(int(left[0]))) if fresh else known.pop(0)
            pinned = tuple(path for path in layout.texts if _NAMES.search(path)) if pin else ()
            rows = left if patience > 0 else left[:1]  # where hardly two are alike, comparing all is quadratic
            patience -= fresh * len(rows) * layout.width
            same, excerpt = layout.matches(messages if len(rows) == len(messages) else messages[rows], pinned)
            if fresh:
                if not same[0]:  # it would be read for ever
                    raise LogError(f"topic {self._topic.name}: a message does not have the topic's layout")
                self._layouts = _latest([layout, *self._layouts])
            if same.any():
                yield layout, rows[same], excerpt
            left = left[~same] if len(rows) == len(left) else left[1:]


def _latest(layouts: list[MessageLayout]) -> list[MessageLayout]:
    """Return the layouts that are kept: the first, and others as long as all of them are small."""
    kept = layouts[:_LAYOUTS]
    while len(kept) > 1 and sum(layout.cost for layout in kept) > FREE:
        kept.pop()
    return kept


_NOWHERE = FieldPlace(0, "S")


def _place(layout: MessageLayout, reading: FieldReading | None) -> tuple[FieldPlace, int | None]:
    if reading is None:
        return _NOWHERE, None
    return layout.places.get(reading.path, _NOWHERE), reading.index


def _in_order(tables: list[TopicTable], width: int) -> TopicTable:
    """One table in the order of the messages."""
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
    return path.endswith("frame_id") or _NAMES.search(path) is not None


def _words(text: bytes) -> str:
    return text.rstrip(b"\0").decode(errors="replace")


def _resolved(layout: MessageLayout, reading: FieldReading) -> FieldReading | None:
    """Where a reading lies in a layout, with the joint or child frame found by its name; None where it is not there."""
    if reading.select is None:
        return reading
    for path, text in layout.texts.items():
        if _NAMES.search(path) and _words(text) == reading.select:
            if path.startswith("name["):
                return FieldReading(reading.path, int(path[5:-1]))
            before, dot, _ = path.rpartition(".")
            rest = re.sub(r"^\w+(\[\d*\])?\.", "", reading.path) if dot else reading.path
            return FieldReading(f"{before}{dot}{rest}", reading.index)
    return None


def _stamp_path(layout: MessageLayout, readings: Sequence[FieldReading]) -> str | None:
    """Return the header stamp that belongs to the readings: that of the element they are in, else that of the
    message."""
    inner = [reading.path.rpartition("].")[0] + "]." for reading in readings if "]." in reading.path]
    for path in (*(f"{prefix}header.stamp" for prefix in inner), "header.stamp", "stamp"):
        if f"{path}.sec" in layout.places and f"{path}.nanosec" in layout.places:
            return path
    return None
