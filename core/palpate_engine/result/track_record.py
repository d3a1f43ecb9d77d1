"""The record of a track while it runs: counts over the whole run, and the last few seconds in full."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate.errors import RAISED_BY_PARTS, PalpateError, error_in
from palpate.estimation import Estimates, Samples, Status
from palpate.evidence.track_tail import Tail
from palpate.fit_report import FitReport
from palpate.flags import Flag
from palpate.vectors import Floats

from palpate_engine.result.sample_keeper import Keeper
from palpate_engine.result.track_result import TrackSummary

SWEEP = 2e-3  # [m] between the places of a track, from which on it is a sweep; a choice


@dataclass
class TrackRecord:
    """Counts of one track over the whole run, and its tail."""

    keep: float  # [s] of tail
    samples: int = 0  # tracked
    nanoseconds: int = 0  # tracked [ns]; whole numbers add up to the same sum in any order
    seconds: float = 0.0  # of computing
    marks: dict[Status, int] = field(default_factory=lambda: dict.fromkeys(Status, 0))
    details: Mapping[str, Any] = field(default_factory=dict)  # of the latest block with details
    report: FitReport | None = None  # of the latest block with one
    timing_included: bool = False
    flags: tuple[Flag, ...] = ()  # that the estimator itself raised
    failure: Flag | None = None  # why the track ended before the record did
    _lateral: Floats | None = None  # (2, 2) [m] least and largest x and y while tracked
    keeper: Keeper = field(default_factory=Keeper)  # of the whole record, for diagnoses
    summaries: dict[str, TrackSummary] = field(default_factory=dict)  # by name
    _blocks: list[Tail] = field(default_factory=list)

    def add(self, samples: Samples, estimates: Estimates, seconds: float) -> None:
        """Take in a block of samples, its estimates, and the time [s] that they took to compute."""
        self.seconds += seconds
        self.keeper.add(samples, estimates)
        self._summarise(samples, estimates)
        self.details = estimates.details or self.details
        self.report = estimates.report or self.report
        self.timing_included |= estimates.timing_included
        self.flags += tuple(flag for flag in estimates.flags if flag not in self.flags)
        present = int(np.bitwise_or.reduce(estimates.status, initial=0))
        for mark in Status:
            if present & mark:
                self.marks[mark] += int(np.count_nonzero(estimates.status & mark))

        # Counts of the samples that have an estimate.
        tracked = (estimates.status & Status.IDLE) == 0
        count = int(np.count_nonzero(tracked))
        if not count:
            return
        rows: Any = tracked if count < len(tracked) else slice(None)
        self.samples += count
        self.nanoseconds += int(np.rint(samples.interval[rows] * 1e9).astype(np.int64).sum())
        self._extend_range(samples.lateral[rows])

        # The tail; older samples of the block would be dropped at once.
        end = float(samples.time[len(tracked) - 1 - int(np.argmax(tracked[::-1]))])
        tracked &= samples.time >= end - self.keep
        begin = int(np.argmax(tracked))
        rows = slice(begin, None) if tracked[begin:].all() else tracked
        measured = (samples.time, samples.force, samples.position, samples.velocity)
        estimated = (estimates.values, estimates.std, estimates.surface, estimates.surface_std)
        predicted = (estimates.force, estimates.nis, estimates.innovation)
        self._blocks.append(Tail(*(column[rows] for column in (*measured, *estimated, *predicted))))
        self._drop_before(end - self.keep)

    def _summarise(self, samples: Samples, estimates: Estimates) -> None:
        """Let every summary take in a block; one that raises is dropped, with a flag that names it and the place."""
        for name, summary in list(self.summaries.items()):
            try:
                summary.add(samples, estimates)
            except PalpateError:
                raise
            except RAISED_BY_PARTS as error:  # whatever third-party code raises
                del self.summaries[name]
                self.flags += (Flag("diagnosis-failed", f"summary {name}: {error_in(error)}"),)

    def _extend_range(self, place: Floats) -> None:
        """Take note of the least and the largest of places (n, 2) [m] that are known."""
        with np.errstate(invalid="ignore"):
            limits = np.array([np.fmin.reduce(place, axis=0), np.fmax.reduce(place, axis=0)])
        if self._lateral is not None:
            limits = np.array([np.fmin(limits[0], self._lateral[0]), np.fmax(limits[1], self._lateral[1])])
        if np.isfinite(limits).any():
            self._lateral = limits

    @property
    def held(self) -> frozenset[str]:
        """Names of the values that a fit holds fixed: settings, not estimates."""
        unknowns = self.report.unknowns if self.report else {}
        return frozenset(name for name, unknown in unknowns.items() if not unknown.free)

    @property
    def is_sweep(self) -> bool:
        """True if the track was at places further apart than a palpation needs; False where places are unknown."""
        return self._lateral is not None and float(np.nanmax([0.0, *(self._lateral[1] - self._lateral[0])])) > SWEEP

    @property
    def tracked(self) -> float:
        """Time [s] of all tracked samples together."""
        return self.nanoseconds / 1e9

    def _drop_before(self, time: float) -> None:
        """Drop the blocks of the tail that end before a time [s]."""
        while len(self._blocks) > 1 and self._blocks[0].time[-1] < time:
            self._blocks.pop(0)

    def ends(self, average: float) -> tuple[Tail, Tail] | None:
        """Return the tail, and its last `average` [s]; None without usable numbers."""
        tail = self.tail
        if tail is None or self.marks[Status.DIVERGED] or self.failure is not None:
            return None
        return tail, tail.last(average)

    @property
    def tail(self) -> Tail | None:
        """The last seconds of tracked samples; None where nothing was tracked."""
        if not self._blocks:
            return None
        if len(self._blocks) > 1:  # joined once: a live run asks every second
            names = Tail.__dataclass_fields__
            joined = Tail(*(np.concatenate([getattr(block, name) for block in self._blocks]) for name in names))
            self._blocks = [joined.last(self.keep)]
        return self._blocks[0].last(self.keep)
