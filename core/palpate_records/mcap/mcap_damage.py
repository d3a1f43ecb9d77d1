"""What is missing of a damaged MCAP log, and where, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from palpate_records.mcap.mcap_salvage import DamagedPiece

_SHOWN = 5  # pieces that are named one by one


@dataclass
class DamageReport:
    """What one way through a damaged file found."""

    counts: Counter[int] = field(default_factory=Counter)  # messages read of each channel
    said: Mapping[int, int] | None = None  # messages of each channel by the log's own statistics
    losses: Sequence[DamagedPiece] = ()
    first: int | None = None  # [ns] log time of the first message
    last: int | None = None  # [ns] the latest log time
    cut: bool = False  # the file has no end
    repeated: int = 0  # chunks that are there twice
    doubtful: Sequence[str] = ()  # topics whose definition comes from a damaged chunk
    notes: Sequence[str] = ()  # what else is wrong
    nameless: int = 0  # messages whose channel nothing defines

    unchecked: int = 0  # messages that no checksum covers

    @property
    def missing(self) -> str:
        """How much is missing, as far as it is known."""
        if self.said is not None:
            total = sum(self.said.values())
            lost = sum(max(n - self.counts.get(channel, 0), 0) for channel, n in self.said.items())
            more = sum(max(n - self.said.get(channel, 0), 0) for channel, n in self.counts.items())
            words = [f"{lost} of {total} messages are missing, by the log's own statistics"] if lost else []
            return "; ".join([*words, f"it contains {more} messages more than its statistics state"] if more else words)
        gaps = [g for loss in self.losses if (g := self._gap(loss)) > 0]
        span = (self.last or 0) - (self.first or 0) - sum(gaps)
        lost = round(self.counts.total() * sum(gaps) / span) if span > 0 else 0
        words = [f"about {lost} messages are missing, by the rates of the others"] if lost else []
        if self.cut or any(loss.after is None for loss in self.losses):
            words.append("everything after that is lost; its amount is unknown")
        return "; ".join(words)

    @staticmethod
    def _gap(loss: DamagedPiece) -> int:
        return 0 if loss.before is None or loss.after is None else loss.after - loss.before

    def words(self) -> str:
        """Return all of it, on one line; empty where nothing is wrong."""
        where = [self._where(loss) for loss in self.losses[:_SHOWN]]
        if len(self.losses) > _SHOWN:
            where.append(f"and {len(self.losses) - _SHOWN} more pieces")
        found = [f"left out: {'; '.join(where)}"] if where else []
        found += [self.missing] if self.missing else []
        found += self.notes
        if self.repeated:
            found.append(f"{self.repeated} chunks are in it twice, and were read once")
        if self.doubtful:
            found.append(f"the definition of {', '.join(self.doubtful)} comes from a chunk that is damaged")
        if self.nameless:
            found.append(f"{self.nameless} undamaged messages belong to topics whose definitions are lost")
        if self.unchecked:
            found.append(f"{self.unchecked} messages carry no checksum: damage to them would not be seen")
        return "; ".join(found)

    def _where(self, loss: DamagedPiece) -> str:
        sides = [None if t is None or self.first is None else (t - self.first) / 1e9 for t in (loss.before, loss.after)]
        if sides[0] is not None and sides[1] is not None:
            low, high = sorted((sides[0], sides[1]))  # messages need not be in the order of their times
            time = f" (between {low:.3f} s and {high:.3f} s)"
        elif sides[0] is not None:
            time = f" (after {sides[0]:.3f} s)"
        else:
            time = "" if sides[1] is None else f" (before {sides[1]:.3f} s)"
        return f"bytes {loss.begin} to {loss.end}{time}: {loss.why}"
