"""Statistics of a topic: its publisher, the clock of its stamps, and its lost messages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from palpate_kit.acquisition.device_clock import LEAK, ClockMap
from palpate_records.messages.topics import Stamps

_SECOND = 1e9  # [ns]
_TAKEOVER_SILENCE = 500_000_000  # [ns] after which another publisher may take over: a choice (0160)
_LONG_STEP = 5  # usual steps, a choice: beyond them, a publisher has paused
_USUAL_STEP_SHARE = 0.1  # of a new step in the running mean, a choice: the mean is of some ten steps
_MAX_STEP_RATIO = 10  # usual steps, a choice: a longer one counts as so many in the mean
_MAX_STEP_BACK = 10_000_000  # [ns], a choice: stamps go back by less where messages overtake each other
_MAX_LEAP = 500_000_000  # [ns], a choice: stamps that go further ahead of the arrivals are of a clock that was set
_STEPS_FOR_USUAL = 50  # a choice: so many steps determine the usual one, and so many regular ones end a delay
_MAX_IRREGULARITY = 0.5  # of the usual step, a choice: half of a message
_PAUSE = 1_000_000_000  # [ns], a choice: a longer step is a pause of the sender, and not a loss


@dataclass
class Publisher:
    """The followed publisher of a topic; another one takes over when it has left or is silent."""

    accepts_all: bool = False  # several publishers may send side by side, each a part of the readings
    writer: int | None = None  # number of the followed publisher
    changes: int = 0
    ignored: int = 0  # messages of other publishers
    _last_arrival: int = 0  # [ns]; 0: none, or the publisher has left
    _usual_step: float = 0.0  # [ns] between arrivals, a running mean

    def accepts(self, writer: int, arrival: int) -> bool:
        """Return True if a message of a writer, with its time of arrival [ns], is one of the followed publisher."""
        if self.accepts_all:
            return True
        if self.writer is None:
            self.writer = writer
        if writer == self.writer:
            self._update_usual_step(arrival)
        else:
            # Another writer takes over once the followed one is silent.
            if arrival - self._last_arrival < max(_TAKEOVER_SILENCE, _LONG_STEP * self._usual_step):
                self.ignored += 1
                return False
            self.writer = writer
            self.changes += 1
        self._last_arrival = arrival
        return True

    def _update_usual_step(self, arrival: int) -> None:
        """Add the step from the last arrival to this one [ns] to the running mean."""
        if not self._last_arrival:
            return
        step = float(arrival - self._last_arrival)
        if self._usual_step:
            step = min(step, _MAX_STEP_RATIO * self._usual_step)
            self._usual_step = (1 - _USUAL_STEP_SHARE) * self._usual_step + _USUAL_STEP_SHARE * step
        else:
            self._usual_step = step

    def note_departure(self, writer: int) -> None:
        """Let the next publisher take over at once, if the writer that leaves is the followed one."""
        if writer == self.writer:
            self._last_arrival = 0


@dataclass
class StampClock:
    """Map of one writer's stamps to the host's clock; it starts again where the writer's clock leaps."""

    restarts: int = 0
    _map: ClockMap = field(default_factory=ClockMap)
    _last: tuple[int, int] | None = None  # stamp and arrival [ns]

    def to_host(self, stamps: Stamps, received: Stamps) -> Stamps:
        """Return host times [ns] (n,) of stamps [ns] (n,) that arrived at host times [ns] (n,)."""
        mapped = np.empty(len(stamps), np.int64)
        start = 0  # index of the first stamp after the latest leap
        for i, (stamp, arrival) in enumerate(zip(stamps.tolist(), received.tolist(), strict=True)):
            if self._last is not None and _has_leapt(stamp - self._last[0], arrival - self._last[1]):
                mapped[start:i] = self._map.to_host(stamps[start:i], received[start:i])
                self._map = ClockMap()
                self.restarts += 1
                start = i
            self._last = stamp, arrival
        mapped[start:] = self._map.to_host(stamps[start:], received[start:])
        return mapped

    @property
    def deviation(self) -> float:
        """Deviation [s] of the map from that of a clock that runs evenly."""
        return self._map.deviation


@dataclass(frozen=True)
class _MappedStamp:
    """Stamp, time of arrival and host time [ns] of a message."""

    stamp: int
    arrival: int
    host: int


@dataclass
class CommonClock:
    """Map of the stamps of several topics, all by one clock, to the host's clock: delays between topics are kept.

    host = stamp + offset, with the lower envelope of (arrival - stamp) of all topics as the offset. It may rise by
    `LEAK` of the time, as clocks run apart.
    """

    restarts: int = 0
    _offset: float | None = None  # [ns]
    _latest_arrival: int = 0  # [ns]
    _last: dict[str, _MappedStamp] = field(default_factory=dict)  # by topic
    _least_delays: dict[str, int] = field(default_factory=dict)  # by topic: smallest (arrival - stamp) [ns]

    def to_host(self, topic: str, stamps: Stamps, received: Stamps) -> Stamps:
        """Return host times [ns] (n,) of stamps [ns] (n,) that arrived at host times [ns] (n,)."""
        pairs = zip(stamps.tolist(), received.tolist(), strict=True)
        return np.array([self._host_time(topic, stamp, arrival) for stamp, arrival in pairs], np.int64)

    def _host_time(self, topic: str, stamp: int, arrival: int) -> int:
        """Return the host time [ns] of the next stamp of a topic."""
        last = self._last.get(topic)
        if last is not None and _has_leapt(stamp - last.stamp, arrival - last.arrival):
            self._restart()
            last = None
        # Lower envelope of the delays.
        delay = arrival - stamp
        envelope = float(delay)
        if self._offset is not None:
            envelope = self._offset + LEAK * max(arrival - self._latest_arrival, 0)
        self._offset = min(float(delay), envelope)
        self._latest_arrival = max(arrival, self._latest_arrival)
        self._least_delays[topic] = min(self._least_delays.get(topic, delay), delay)
        # Host times of later stamps of a topic never fall back.
        host = stamp + round(self._offset)
        if last is not None and host <= last.host and stamp > last.stamp:
            host = last.host + 1
        self._last[topic] = _MappedStamp(stamp, arrival, host)
        return host

    def _restart(self) -> None:
        """Forget the map of a clock that has leapt."""
        self._offset = None
        self.restarts += 1
        self._least_delays.clear()
        self._last.clear()

    @property
    def delay_range(self) -> tuple[str, str, float] | None:
        """Topic of the smallest delay, topic of the largest, and their difference [s]; None for fewer than two."""
        if len(self._least_delays) < 2:
            return None
        earliest = min(self._least_delays, key=self._least_delays.__getitem__)
        latest = max(self._least_delays, key=self._least_delays.__getitem__)
        return earliest, latest, (self._least_delays[latest] - self._least_delays[earliest]) / _SECOND


def _has_leapt(stamp_step: int, arrival_step: int) -> bool:
    """Return True if a clock was set between two stamps, by the steps of stamps and of arrivals [ns]."""
    return stamp_step < -_MAX_STEP_BACK or stamp_step - arrival_step > _MAX_LEAP


@dataclass
class Losses:
    """Counter of the messages that are missing between stamps, by the usual step.

    A publisher that was held up sends late, and then several at once: messages that follow soon after a long step are
    not lost. Nor are those that arrive behind their successors. Both are overdue first, and missing after
    `_STEPS_FOR_USUAL` regular steps without them.
    """

    missing: int = 0
    pauses: int = 0
    _first_steps: list[int] = field(default_factory=list)  # [ns], until the usual step is determined
    _usual_step: float = 0.0  # [ns]; 0 before it is determined
    _last_stamp: int | None = None  # [ns]
    _overdue: float = 0.0  # messages
    _regular_steps: int = 0  # since the last irregular one

    def add(self, stamps: Stamps) -> None:
        """Count the losses between stamps [ns] (n,) of one publisher, in the order of arrival."""
        steps = list(self._steps(stamps))
        if not self._usual_step:
            self._first_steps += steps
            if len(self._first_steps) < _STEPS_FOR_USUAL:
                return
            self._usual_step = float(np.median(self._first_steps))
            steps = self._first_steps
        for step in steps:
            self._count(step)

    def _steps(self, stamps: Stamps) -> Iterator[int]:
        """Yield the steps [ns] from the latest stamp to each one, negative for a message behind its successors."""
        for stamp in stamps.tolist():
            last = self._last_stamp
            is_overtaken = last is not None and 0 < last - stamp < _MAX_LEAP
            if last is not None and (is_overtaken or stamp >= last):
                yield stamp - last
            # A stamp that is far back begins a new clock, without a step to it.
            if not is_overtaken:
                self._last_stamp = stamp

    def _count(self, step: int) -> None:
        """Count the messages that a step [ns] between stamps lacks, or those overdue that it brings."""
        if step < 0:
            # A message behind its successors was overdue until now, or already counted as missing.
            if self._overdue >= 1.0:
                self._overdue -= 1.0
            else:
                self.missing = max(self.missing - 1, 0)
        elif step > max(_PAUSE, _LONG_STEP * self._usual_step):
            self.pauses += 1
        elif abs(step / self._usual_step - 1) > _MAX_IRREGULARITY:
            # A long step lacks messages, a short one brings some of them.
            self._overdue = max(self._overdue + step / self._usual_step - 1, 0.0)
            self._regular_steps = 0
        elif self._overdue:
            self._regular_steps += 1
            if self._regular_steps > _STEPS_FOR_USUAL:
                self.missing += round(self._overdue)
                self._overdue = 0.0

    def restart(self) -> None:
        """Begin with another publisher: what lies between its stamps and the former ones is not a loss."""
        self._last_stamp = None

    @property
    def rate(self) -> float | None:
        """The usual rate [Hz]; None before it is determined."""
        return _SECOND / self._usual_step if self._usual_step > 0 else None


@dataclass
class TopicAccount:
    """Publisher, losses and numbers of messages of one topic."""

    publisher: Publisher
    losses: Losses = field(default_factory=Losses)
    messages: int = 0
    damaged: int = 0

    def table(self) -> dict[str, float | int | None]:
        """Return the table of the topic in a record."""
        return {
            "messages": self.messages,
            "missing": self.losses.missing,
            "pauses": self.losses.pauses,
            "damaged": self.damaged,
            "publishers": self.publisher.changes + 1,
            "ignored": self.publisher.ignored,
            "rate": self.losses.rate,
        }
