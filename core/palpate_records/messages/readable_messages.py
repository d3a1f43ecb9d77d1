"""The messages of a topic that can be read, and a count of those that cannot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from palpate import LogError

from palpate_records.messages.memory_budget import BudgetError
from palpate_records.messages.topics import Messages

_REFUSALS = 1000  # messages that are left out one by one, each counted once and once more for every 64 bytes

_Read = TypeVar("_Read")


class ReadableMessages:
    """Reads blocks of a topic around single messages that cannot be read.

    Where too many are refused, or one would take too much memory, the rest of the topic is left out with them.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self.seen = self.left_out = self._refused = 0
        self.reason = ""  # of the first that was left out

    def results(self, messages: Messages, read: Callable[[Messages], _Read]) -> Iterator[tuple[Messages, _Read]]:
        """What `read` makes of a block, in as few pieces as its damage allows."""
        self.seen += len(messages)
        waiting = [messages]
        while waiting:
            some = waiting.pop()
            if self.ended:
                self.left_out += len(some)
                continue
            try:
                result = read(some)
            except LogError as error:
                if len(some) > 1 and not isinstance(error, BudgetError):
                    middle = len(some) // 2
                    waiting += [some[middle:], some[:middle]]
                else:
                    self._leave_out(some, error)
                continue
            yield some, result

    def _leave_out(self, messages: Messages, error: LogError) -> None:
        self.reason = self.reason or str(error).removeprefix(f"topic {self._topic}: ")
        self.left_out += len(messages)
        size = int(messages.lengths.sum())
        self._refused += _REFUSALS if isinstance(error, BudgetError) else 1 + size // 64

    @property
    def ended(self) -> bool:
        """True if the rest of the topic is left out."""
        return self._refused >= _REFUSALS

    @property
    def note(self) -> str:
        """How many messages were left out, and why; empty where none was."""
        if not self.left_out:
            return ""
        if self.left_out == self.seen:
            return f"no message of it can be read: {self.reason}" if self.seen > 1 else self.reason
        return f"{self.left_out} of {self.seen} messages were left out: {self.reason}"
