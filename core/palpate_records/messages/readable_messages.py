"""The readable messages of a topic, and the number of the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from palpate import LogError

from palpate_records.messages.memory_budget import BudgetError
from palpate_records.messages.topics import Messages

# Choices.
_MAX_REFUSALS = 1000  # points of messages that are left out one by one: one each, and one more for some bytes
_BYTES_PER_REFUSAL = 64

_Read = TypeVar("_Read")


class ReadableMessages:
    """A reader of blocks of a topic around single unreadable messages.

    After too many of them, or one that would take too much memory, the rest of the topic is left out.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self.count = 0
        self.left_out = 0
        self._refusals = 0
        self.reason = ""  # for which the first message was left out

    def results(self, messages: Messages, read: Callable[[Messages], _Read]) -> Iterator[tuple[Messages, _Read]]:
        """Yield the result of `read` for each readable piece of a block, with the piece; as few as damage allows.

        `read` raises LogError for a piece with an unreadable message: it is halved, down to that message, which is left
        out.
        """
        self.count += len(messages)
        pending = [messages]
        while pending:
            piece = pending.pop()
            if self.ended:
                self.left_out += len(piece)
                continue
            try:
                contents = read(piece)
            except LogError as error:
                # Halves, to find the unreadable messages.
                if len(piece) > 1 and not isinstance(error, BudgetError):
                    middle = len(piece) // 2
                    pending += [piece[middle:], piece[:middle]]
                else:
                    self._leave_out(piece, error)
                continue
            yield piece, contents

    def _leave_out(self, messages: Messages, error: LogError) -> None:
        """Count messages that cannot be read; the reason is that of the first."""
        self.reason = self.reason or str(error).removeprefix(f"topic {self._topic}: ")
        self.left_out += len(messages)
        size = int(messages.lengths.sum())
        self._refusals += _MAX_REFUSALS if isinstance(error, BudgetError) else 1 + size // _BYTES_PER_REFUSAL

    @property
    def ended(self) -> bool:
        """True if the rest of the topic is left out."""
        return self._refusals >= _MAX_REFUSALS

    @property
    def note(self) -> str:
        """A sentence on the number of messages that were left out, and the reason; empty if none was."""
        if not self.left_out:
            return ""
        if self.left_out == self.count:
            return f"no message of it can be read: {self.reason}" if self.count > 1 else self.reason
        return f"{self.left_out} of {self.count} messages were left out: {self.reason}"
