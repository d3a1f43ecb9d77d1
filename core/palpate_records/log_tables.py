"""The topics of a log as tables: every number and every text, as recorded."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from palpate import Batch, LogError

from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.memory_budget import Budget, BudgetError
from palpate_records.messages.readable_messages import ReadableMessages
from palpate_records.messages.readings import FieldReading, TopicTable
from palpate_records.messages.topics import Container, Messages, Stamps, Topic
from palpate_records.survey import columns_of

# Choices.
_MAX_COLUMNS = 100_000  # of the table of a topic
_MAX_ELEMENTS = 1000  # of an array that are columns
_TABLE_BYTES = 8  # [bytes] of a table per byte of its messages
_CELL_SIZE = 8  # [bytes] of a float64


def tables_of(container: Container, notes: list[str] | None = None) -> Iterator[tuple[str, tuple[str, ...], Batch]]:
    """Yield every topic that contains numbers, in blocks, as recorded; add what is left out to the notes."""
    plans: dict[str, _TopicPlan | str] = {}
    for topic, messages in container.blocks(set(container.topics)):
        plan = _plan_of(container.topics[topic], plans)
        if isinstance(plan, str):
            continue
        for piece, table in plan.messages.results(messages, plan.numbers):
            logged = piece.logged[table.rows]
            stamps = logged if table.stamps is None else table.stamps
            yield topic, plan.columns or (), Batch(topic, stamps, logged, table.values)
    if notes is not None:
        notes += [note for topic, plan in plans.items() for note in _notes(topic, plan)]
        notes += [container.trouble] if container.trouble else []


def texts_of(container: Container) -> Iterator[tuple[str, tuple[str, ...], Stamps, list[tuple[str, ...]]]]:
    """Yield every topic that contains texts, in blocks: its name, the names of the texts, stamps [ns] and texts."""
    plans: dict[str, _TopicPlan | str] = {}
    for topic, messages in container.blocks(set(container.topics)):
        plan = _plan_of(container.topics[topic], plans)
        if isinstance(plan, str) or plan.columns == ():
            continue
        for piece, (stamps, rows) in plan.messages.results(messages, plan.texts):
            if plan.columns:
                yield topic, plan.columns, piece.logged if stamps is None else stamps, rows


class _TopicPlan:
    """The columns of a topic's table, by its first readable message."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic.name
        self._decoder = decoder_of(topic)
        self.messages = ReadableMessages(topic.name)
        self.columns: tuple[str, ...] | None = None
        self.long_arrays: dict[str, int] = {}  # elements of arrays that have more than columns

    def numbers(self, messages: Messages) -> TopicTable:
        """Return the numbers of a block; raises LogError."""
        if self.columns is None:
            fields = self._decoder.fields(messages.payload(0))
            columns = tuple(islice(columns_of(fields, _MAX_ELEMENTS), _MAX_COLUMNS + 1))
            if len(columns) > _MAX_COLUMNS:
                raise BudgetError(f"topic {self._topic}: a message has more than {_MAX_COLUMNS} numbers")
            self.columns = columns
            self.long_arrays = {
                path: count for path, count in fields.items() if count is not None and count > _MAX_ELEMENTS
            }
        self._charge(messages)
        return self._decoder.read(messages, [FieldReading.parse(name) for name in self.columns])

    def texts(self, messages: Messages) -> tuple[Stamps | None, list[tuple[str, ...]]]:
        """Return the texts of a block and its stamps [ns]; raises LogError."""
        if self.columns is None:
            self.columns = tuple(self._decoder.texts(messages.payload(0)))
        self._charge(messages)
        stamps = self._decoder.read(messages, ()).stamps
        texts_by_row = [self._decoder.texts(messages.payload(row)) for row in range(len(messages))]
        return stamps, [tuple(texts.get(name, "") for name in self.columns) for texts in texts_by_row]

    def _charge(self, messages: Messages) -> None:
        """Raise BudgetError for far more cells than the messages have bytes, as of many short ones after a long one."""
        cells = len(messages) * len(self.columns or ())
        Budget(f"topic {self._topic}", int(messages.lengths.sum()), per_byte=_TABLE_BYTES).charge(_CELL_SIZE * cells)


def _plan_of(topic: Topic, plans: dict[str, _TopicPlan | str]) -> _TopicPlan | str:
    """Return the plan of a topic, or the reason for which it has none."""
    if topic.name not in plans:
        try:
            plans[topic.name] = _TopicPlan(topic)
        except LogError as error:
            plans[topic.name] = str(error).removeprefix(f"topic {topic.name}: ")
    return plans[topic.name]


def _notes(topic: str, plan: _TopicPlan | str) -> Iterator[str]:
    """Yield sentences on the parts of a topic that are left out, with the reasons."""
    if isinstance(plan, str):
        yield f"{topic} is left out: {plan}"
        return
    if plan.messages.left_out:
        yield f"{topic}: {plan.messages.note}"
    for path, count in plan.long_arrays.items():
        yield f"{topic}: of the {count} elements of {path} the first {_MAX_ELEMENTS} are columns"
