"""Who publishes a topic, by which clock, and what of it was lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from palpate_kit.acquisition.device_clock import LEAK, ClockMap
from palpate_records.messages.topics import Stamps

_SILENT = 500_000_000  # [ns] after which another publisher may take over
_SLOW = 5  # usual intervals
_BACK = 10_000_000  # [ns] that stamps may go back within a clock
_LEAP = 500_000_000  # [ns] by which they may go ahead of the arrivals
_KNOWN = 50  # steps that determine the usual one
_IRREGULAR = 0.5  # of the usual step
_PAUSE = 1_000_000_000  # [ns]; longer is not a loss, but a pause of the sender


@dataclass
class Publisher:
    """Follows one publisher of a topic, and another when that one has gone."""

    many: bool = False  # whether several may send side by side, each a part of the whole
    writer: int | None = None
    changes: int = 0
    ignored: int = 0  # messages of others
    _last: int = 0
    _usual: float = 0.0

    def takes(self, writer: int, arrival: int) -> bool:
        """Return True if a message of a writer at a time [ns] counts."""
        if self.many:
            return True
        if self.writer is None:
            self.writer = writer
        if writer != self.writer:
            if arrival - self._last < max(_SILENT, _SLOW * self._usual):
                self.ignored += 1
                return False
            self.writer, self.changes = writer, self.changes + 1
        elif self._last:
            step = float(arrival - self._last)
            self._usual = step if not self._usual else 0.9 * self._usual + 0.1 * min(step, 10 * self._usual)
        self._last = arrival
        return True

    def left(self, writer: int) -> None:
        """A writer has announced that it leaves."""
        if writer == self.writer:
            self._last = 0


@dataclass
class StampClock:
    """Stamps of one writer on the host's clock; a clock that leaps is another one."""

    restarts: int = 0
    _map: ClockMap = field(default_factory=ClockMap)
    _last: tuple[int, int] | None = None

    def to_host(self, stamps: Stamps, received: Stamps) -> Stamps:
        """Host time [ns] (n,) of stamps [ns] (n,) that arrived at host times [ns] (n,)."""
        mapped = np.empty(len(stamps), np.int64)
        begin = 0
        for i, (stamp, arrival) in enumerate(zip(stamps.tolist(), received.tolist(), strict=True)):
            if self._last is not None and _leapt(stamp - self._last[0], arrival - self._last[1]):
                mapped[begin:i] = self._map.to_host(stamps[begin:i], received[begin:i])
                self._map, self.restarts, begin = ClockMap(), self.restarts + 1, i
            self._last = stamp, arrival
        mapped[begin:] = self._map.to_host(stamps[begin:], received[begin:])
        return mapped

    @property
    def deviation(self) -> float:
        """How far the map was [s] from that of a clock that runs evenly."""
        return self._map.deviation


@dataclass
class CommonClock:
    """Stamps of several topics by one clock: moved to the host's clock together, so that delays between them are kept.

    The lower envelope is that of all arrivals, whichever topic is the fastest.
    """

    restarts: int = 0
    _offset: float | None = None  # [ns]
    _arrival: int = 0
    _last: dict[str, tuple[int, int, int]] = field(default_factory=dict)  # by topic: stamp, arrival, host time [ns]
    _least: dict[str, int] = field(default_factory=dict)  # by topic: from stamp to arrival [ns]

    def to_host(self, topic: str, stamps: Stamps, received: Stamps) -> Stamps:
        """Host time [ns] (n,) of stamps [ns] (n,) that arrived at host times [ns] (n,)."""
        mapped = np.empty(len(stamps), np.int64)
        for i, (stamp, arrival) in enumerate(zip(stamps.tolist(), received.tolist(), strict=True)):
            known = self._last.get(topic)
            if known is not None and _leapt(stamp - known[0], arrival - known[1]):
                self._offset, self.restarts = None, self.restarts + 1
                self._least.clear()
                self._last.clear()
                known = None
            late = arrival - stamp
            risen = late if self._offset is None else self._offset + LEAK * max(arrival - self._arrival, 0)
            self._offset, self._arrival = min(float(late), risen), max(arrival, self._arrival)
            self._least[topic] = min(self._least.get(topic, late), late)
            host = stamp + round(self._offset)
            if known is not None and host <= known[2] and stamp > known[0]:
                host = known[2] + 1
            self._last[topic] = stamp, arrival, host
            mapped[i] = host
        return mapped

    @property
    def apart(self) -> tuple[str, str, float] | None:
        """The topic that is the least late, the one that is the most, and by how much more [s]."""
        if len(self._least) < 2:
            return None
        ahead, behind = (pick(self._least, key=self._least.__getitem__) for pick in (min, max))
        return ahead, behind, (self._least[behind] - self._least[ahead]) / 1e9


def _leapt(step: int, passed: int) -> bool:
    """Return True if a clock leapt whose stamps went on by a step [ns] while so much [ns] passed."""
    return step < -_BACK or step - passed > _LEAP


@dataclass
class Losses:
    """Messages that are missing between stamps, by the usual step.

    A publisher that was held up sends late, and then several at once: what comes soon after a long step is not lost.
    Nor is what comes behind its successors.
    """

    missing: int = 0
    pauses: int = 0
    _steps: list[int] = field(default_factory=list)
    _usual: float = 0.0
    _last: int | None = None
    _debt: float = 0.0  # messages that should have arrived before now
    _regular: int = 0  # steps since the debt last changed

    def add(self, stamps: Stamps) -> None:
        """Stamps [ns] of one publisher as they came."""
        steps = [step for stamp in stamps.tolist() if (step := self._step(stamp)) is not None]
        if not self._usual:
            self._steps += steps
            if len(self._steps) < _KNOWN:
                return
            self._usual, steps = float(np.median(self._steps)), self._steps
        for step in steps:
            self._count(step)

    def _step(self, stamp: int) -> int | None:
        """From the latest stamp to this one, negative where this one comes late; None where a clock begins."""
        last = self._last
        if last is not None and 0 < last - stamp < _LEAP:
            return stamp - last
        self._last = stamp
        return None if last is None or stamp < last else stamp - last

    def _count(self, step: int) -> None:
        if step < 0:
            covered = self._debt >= 1.0
            self._debt, self.missing = self._debt - covered, max(self.missing - (not covered), 0)
        elif step > max(_PAUSE, _SLOW * self._usual):
            self.pauses += 1
        elif abs(step / self._usual - 1) > _IRREGULAR:
            self._debt, self._regular = max(self._debt + step / self._usual - 1, 0.0), 0
        elif self._debt:
            self._regular += 1
            if self._regular > _KNOWN:
                self.missing, self._debt = self.missing + round(self._debt), 0.0

    def anew(self) -> None:
        """Another publisher sends: what lies between is not a loss."""
        self._last = None

    @property
    def rate(self) -> float | None:
        """The usual rate [Hz]; None where that is not known yet."""
        return 1e9 / self._usual if self._usual > 0 else None


@dataclass
class TopicAccount:
    """All that is known of one topic."""

    publisher: Publisher
    losses: Losses = field(default_factory=Losses)
    counts: Counter[str] = field(default_factory=Counter)

    def table(self) -> dict[str, float | int | None]:
        """As in a record."""
        return {
            "messages": self.counts["messages"],
            "missing": self.losses.missing,
            "pauses": self.losses.pauses,
            "damaged": self.counts["damaged"],
            "publishers": self.publisher.changes + 1,
            "ignored": self.publisher.ignored,
            "rate": self.losses.rate,
        }
