"""The report on a damaged MCAP log: the pieces and the number of messages that are missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from palpate_records.mcap.mcap_salvage import DamagedPiece

_MAX_SHOWN = 5  # pieces that are named one by one: a choice
_NANOSECONDS = 1e9  # in a second


@dataclass
class DamageReport:
    """The losses that one pass through a damaged file found."""

    counts: Counter[int] = field(default_factory=Counter)  # messages read of each channel
    stated_counts: Mapping[int, int] | None = None  # messages of each channel by the log's own statistics
    losses: Sequence[DamagedPiece] = ()
    first: int | None = None  # [ns] log time of the first message
    last: int | None = None  # [ns] the latest log time
    cut: bool = False  # the file has no end
    repeated: int = 0  # chunks that the file has twice
    doubtful: Sequence[str] = ()  # topics whose definition comes from a damaged chunk
    notes: Sequence[str] = ()  # on the file as a whole
    nameless: int = 0  # messages whose channel is not defined
    unchecked: int = 0  # messages that no checksum covers

    @property
    def missing(self) -> str:
        """A sentence on the number of missing messages, as far as it is known; "" if none is missing."""
        return (
            self._missing_by_rates() if self.stated_counts is None else self._missing_by_statistics(self.stated_counts)
        )

    def _missing_by_statistics(self, stated_counts: Mapping[int, int]) -> str:
        """Return the sentence by the log's own statistics, which state more or fewer messages than were read."""
        lost = sum(max(count - self.counts.get(channel, 0), 0) for channel, count in stated_counts.items())
        excess = sum(max(count - stated_counts.get(channel, 0), 0) for channel, count in self.counts.items())
        parts = []
        if lost:
            total = sum(stated_counts.values())
            parts.append(f"{lost} of {total} messages are missing, by the log's own statistics")
        if excess:
            parts.append(f"it contains {excess} messages more than its statistics state")
        return "; ".join(parts)

    def _missing_by_rates(self) -> str:
        """Return the sentence by the usual number of messages in the time of each gap."""
        gaps = [gap for loss in self.losses if (gap := self._gap(loss)) > 0]
        span = (self.last or 0) - (self.first or 0) - sum(gaps)
        lost = round(self.counts.total() * sum(gaps) / span) if span > 0 else 0
        parts = [f"about {lost} messages are missing, by the rates of the others"] if lost else []
        if self.cut or any(loss.after is None for loss in self.losses):
            parts.append("everything after that is lost; its amount is unknown")
        return "; ".join(parts)

    @staticmethod
    def _gap(loss: DamagedPiece) -> int:
        """Return the time [ns] between the messages before and behind a loss; 0 if one of them is not known."""
        return 0 if loss.before is None or loss.after is None else loss.after - loss.before

    def words(self) -> str:
        """Return the whole report on one line: pieces left out, what is missing, and messages that nothing checks.

        Empty for a sound file.
        """
        pieces = [self._piece_text(loss) for loss in self.losses[:_MAX_SHOWN]]
        if len(self.losses) > _MAX_SHOWN:
            pieces.append(f"and {len(self.losses) - _MAX_SHOWN} more pieces")
        sentences = [f"left out: {'; '.join(pieces)}"] if pieces else []
        sentences += [self.missing] if self.missing else []
        sentences += self.notes
        if self.repeated:
            sentences.append(f"{self.repeated} chunks are in it twice, and were read once")
        if self.doubtful:
            sentences.append(f"the definition of {', '.join(self.doubtful)} comes from a chunk that is damaged")
        if self.nameless:
            sentences.append(f"{self.nameless} undamaged messages belong to topics whose definitions are lost")
        if self.unchecked:
            sentences.append(f"{self.unchecked} messages carry no checksum: damage to them would not be seen")
        return "; ".join(sentences)

    def _piece_text(self, loss: DamagedPiece) -> str:
        """Return place, time and reason of a loss; the time [s] is that since the first message."""
        before, after = self._seconds(loss.before), self._seconds(loss.after)
        time = ""
        if before is not None and after is not None:
            low, high = sorted((before, after))  # messages need not be in the order of their times
            time = f" (between {low:.3f} s and {high:.3f} s)"
        elif before is not None:
            time = f" (after {before:.3f} s)"
        elif after is not None:
            time = f" (before {after:.3f} s)"
        return f"bytes {loss.begin} to {loss.end}{time}: {loss.why}"

    def _seconds(self, stamp: int | None) -> float | None:
        """Return a log time [ns] in seconds since the first message; None if one of both is not known."""
        return None if stamp is None or self.first is None else (stamp - self.first) / _NANOSECONDS
