"""Samples that are held back until it is known whether they are in contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples

FIRST_SAMPLES = 11  # from which the interval is taken

_AFTER = 0.2  # of the lag: contact that is awaited before its begin is located; the rest is looked back over
_BASELINE = 1.0  # [s] of air that the begin of contact is located against


@dataclass(frozen=True)
class Lookback:
    """How many samples are held back, and for what."""

    interval: float  # [s] between samples
    back: int  # samples that are looked back over, once contact shows
    after: int  # samples of contact that are awaited
    baseline: int  # samples of air before those that are looked back over

    @classmethod
    def of(cls, settings: AlignmentSettings, samples: Samples) -> Lookback:
        """By the beginning of a record, the same however much more has come."""
        first = np.sort(samples.interval[1:FIRST_SAMPLES]).tolist()
        interval = 0.5 * (first[(len(first) - 1) // 2] + first[len(first) // 2]) if first else 0.0  # the median
        if not interval > 0:
            return cls(interval, 0, 0, 0)
        lag = int(settings.touch_lag / interval)
        after = int(_AFTER * lag)
        return cls(interval, lag - after, after, int(_BASELINE / interval))


class HeldSamples:
    """Samples that are held back, and the latest of those that were released before, in order."""

    def __init__(self, lookback: Lookback) -> None:
        self._lookback = lookback
        self._held: Samples | None = None
        self._released: Samples | None = None

    def __len__(self) -> int:
        return 0 if self._held is None else len(self._held)

    @property
    def samples(self) -> Samples:
        """Those that are held back."""
        assert self._held is not None
        return self._held

    def add(self, samples: Samples) -> None:
        """Hold more samples back."""
        self._held = samples if self._held is None else Samples.joined([self._held, samples])

    def release(self, final: bool) -> Samples:
        """Return the first of the samples, all but those that are looked back over, which stay; all where `final`."""
        held = self.samples
        ready = len(held) if final else max(len(held) - self._lookback.back, 0)
        given, self._held = held[:ready], held[ready:]
        released = given if self._released is None else Samples.joined([self._released, given])
        self._released = released[max(len(released) - self._lookback.baseline, 0) :]
        return given

    def stretch(self, begin: int, end: int) -> Samples:
        """Samples from one index to another of what is held, and of a baseline before it."""
        found = self.samples[:end]
        begin -= self._lookback.baseline
        if self._released is not None:
            found = Samples.joined([self._released, found])
            begin += len(self._released)
        return found[max(begin, 0) :]
