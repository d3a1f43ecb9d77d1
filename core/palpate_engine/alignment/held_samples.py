"""Samples that are held back until it is known whether they are in contact."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples

FIRST_SAMPLES = 11  # from which the interval is taken; a choice

_AFTER_SHARE = 0.2  # of the lag: contact that is awaited before its begin is located; a choice (decision 0104)
_BASELINE = 1.0  # [s] of air that the begin of contact is located against; a choice


@dataclass(frozen=True)
class Lookback:
    """Counts of the samples that are held back, and their purposes."""

    interval: float  # [s] between samples
    back: int  # samples that are looked back over, once contact shows
    after: int  # samples of contact that are awaited
    baseline: int  # samples of air before those that are looked back over

    @classmethod
    def of(cls, settings: AlignmentSettings, samples: Samples) -> Lookback:
        """Return the lookback by the beginning of a record, the same however much more has come."""
        intervals = samples.interval[1:FIRST_SAMPLES].tolist()
        interval = statistics.median(intervals) if intervals else 0.0
        if not interval > 0:
            return cls(interval, 0, 0, 0)
        lag = int(settings.touch_lag / interval)
        after = int(_AFTER_SHARE * lag)
        return cls(interval, lag - after, after, int(_BASELINE / interval))


class HeldSamples:
    """Samples that are held back, and the latest of those that were released before, in order."""

    def __init__(self, lookback: Lookback) -> None:
        self._lookback = lookback
        self._held: Samples | None = None
        self._baseline: Samples | None = None  # the latest that were released

    def __len__(self) -> int:
        return 0 if self._held is None else len(self._held)

    @property
    def samples(self) -> Samples:
        """Samples that are held back."""
        assert self._held is not None
        return self._held

    def add(self, samples: Samples) -> None:
        """Hold more samples back."""
        self._held = samples if self._held is None else Samples.joined([self._held, samples])

    def release(self, final: bool) -> Samples:
        """Return the first of the samples, all but those that are looked back over, which stay; all where `final`."""
        held = self.samples
        count = len(held) if final else max(len(held) - self._lookback.back, 0)
        released, self._held = held[:count], held[count:]
        baseline = released if self._baseline is None else Samples.joined([self._baseline, released])
        self._baseline = baseline[max(len(baseline) - self._lookback.baseline, 0) :]
        return released

    def stretch(self, begin: int, end: int) -> Samples:
        """Return the samples from one index to another of those held, and of a baseline before them."""
        samples = self.samples[:end]
        begin -= self._lookback.baseline
        if self._baseline is not None:
            samples = Samples.joined([self._baseline, samples])
            begin += len(self._baseline)
        return samples[max(begin, 0) :]
