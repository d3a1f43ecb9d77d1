"""What is kept of a track while it runs: counts over the whole run, and the last few seconds in full."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from palpate.contact import ContactModel
from palpate.estimation import Estimates, Samples, Status
from palpate.fit_report import FitReport
from palpate.flags import Flag
from palpate.result.kept import Keeper
from palpate.vectors import Floats

if TYPE_CHECKING:
    from palpate.result.outcome import TrackResult

_PARTS = 12  # of the tail, whose steps show a random walk
_SIGMAS = 3.0
_LONG = 20.0  # lengths of the tail, from which on what a filter gains in one is small against its walk
SWEEP = 2e-3  # [m] between the places of a track, from which on it is a sweep
_SLOPE_SAMPLES = 5  # velocity is differenced over so many samples to either side


@dataclass(frozen=True)
class Tail:
    """The latest tracked samples and their estimates."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] measured
    position: Floats  # (n,) [m]
    velocity: Floats  # (n,) [m/s]
    values: Floats  # (n, k)
    std: Floats  # (n, k)
    surface: Floats  # (n,) [m]
    surface_std: Floats  # (n,) [m]
    model_force: Floats  # (n,) [N]
    nis: Floats  # (n,)
    innovation: Floats  # (n,) normalised, with its sign; NaN where the estimator tells none

    def since(self, begin: float) -> Tail:
        """The part from a time [s] on."""
        rows = self.time >= begin
        if rows.all():
            return self
        return Tail(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def unsettled(self, values: Floats, tracked: float) -> Floats:
        """Time tracked [s] times slope of each column of values (n, k): what may be left of its way to rest (k,).

        The error of a filter that settles dies away like a power of time, x(t) = x + c/t^p, so that this is p times
        what is left of it, whatever c is. The filter's own standard deviation knows nothing of that. After a
        long time, a slope that a random walk has by chance says nothing of a way to rest, and counts as none.
        """
        if len(self.time) < 10:
            return np.zeros(values.shape[1])
        values = np.where(np.ptp(values, axis=0) == 0, 0.0, values)  # a slope of one number over and over is rounding
        # Sums, not a linear solve: libraries for that do not promise the same bits twice.
        since = (self.time - self.time.mean())[:, None]
        slopes = (since * (values - values.mean(axis=0))).sum(axis=0) / (since**2).sum()
        if tracked < _LONG * float(self.time[-1] - self.time[0]):
            return np.asarray(np.abs(slopes) * tracked)
        chance = _SIGMAS * self.slope_of_a_walk(values)
        return np.asarray(np.where(np.abs(slopes) > chance, np.abs(slopes) * tracked, 0.0))

    @staticmethod
    def mean(values: Floats) -> Floats:
        """Mean (k,) of the columns of values (n, k); of one number over and over that number."""
        return np.asarray(np.where(np.ptp(values, axis=0) == 0, values[0], values.mean(axis=0)))

    def slope_of_a_walk(self, values: Floats) -> Floats:
        """Standard deviation (k,) of the slope of a random walk with the steps that the values make.

        Steps are those between the means of parts of the tail. A walk with variance q per second has, over a stretch of
        length T, a least-squares slope of variance 1.2 q/T; the means of parts of length h differ by 2/3 q h.
        """
        parts = [part for part in np.array_split(np.arange(len(self.time)), _PARTS) if len(part)]
        means = np.array([values[part].mean(axis=0) for part in parts])
        span = float(self.time[-1] - self.time[0])
        if len(means) < 3 or span <= 0:
            return np.zeros(values.shape[1])
        steps = np.diff(means, axis=0)
        steps = steps - steps.mean(axis=0)  # what is common to all is the slope that is asked about
        square = (steps**2).sum(axis=0) / (len(steps) - 1)
        return np.asarray(np.sqrt(1.2 * 1.5 * square * len(means)) / span)

    def force_rms(self, tip_mass: float) -> float:
        """RMS [N] of measured force less inertia of the tip less the model's force; NaN where it cannot be told."""
        n = _SLOPE_SAMPLES
        if len(self.time) <= 2 * n:
            return float("nan")
        # Height and depth count in opposite directions: u = F + m d'' = F - m z''.
        residual = (self.force - self.model_force + tip_mass * acceleration(self.time, self.velocity))[n:-n]
        residual = residual[np.isfinite(residual)]
        return float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan")


def acceleration(time: Floats, velocity: Floats) -> Floats:
    """Acceleration (n,) [m/s^2] from a velocity (n,) [m/s], differenced over a few samples; NaN at both ends."""
    n = _SLOPE_SAMPLES
    slope = np.full(len(time), np.nan)
    if len(time) > 2 * n:
        slope[n:-n] = (velocity[2 * n :] - velocity[: -2 * n]) / (time[2 * n :] - time[: -2 * n])
    return slope


class TrackSummary(Protocol):
    """What the function of a `palpate.Summary` answers for each track: it takes in blocks and has the last word."""

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block; the same comes of it however a record is cut into blocks."""
        ...

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """What the result becomes when the run has ended; `is_sweep`: the tip went along the surface."""
        ...


@dataclass
class TrackRecord:
    """Counts of one track over the whole run, and its tail."""

    keep: float  # [s] of tail
    samples: int = 0  # tracked
    nanoseconds: int = 0  # tracked [ns]; whole numbers add up to the same sum in any order
    seconds: float = 0.0  # of computing
    marks: dict[Status, int] = field(default_factory=lambda: dict.fromkeys(Status, 0))
    details: Mapping[str, Any] = field(default_factory=dict)  # of the latest block that had any
    report: FitReport | None = None  # of the latest block that had one
    timing_included: bool = False
    flags: tuple[Flag, ...] = ()  # that the estimator itself raised
    failure: Flag | None = None  # why the track ended before the record did
    _lateral: Floats | None = None  # (2, 2) [m] least and largest x and y while tracked
    keeper: Keeper = field(default_factory=Keeper)  # of the whole record, for diagnoses
    summaries: tuple[TrackSummary, ...] = ()
    _blocks: list[Tail] = field(default_factory=list)

    def add(self, samples: Samples, estimates: Estimates, seconds: float) -> None:
        """Take in a block."""
        self.seconds += seconds
        self.keeper.add(samples, estimates)
        for summary in self.summaries:
            summary.add(samples, estimates)
        self.details = estimates.details or self.details
        self.report = estimates.report or self.report
        self.timing_included |= estimates.timing_included
        self.flags += tuple(flag for flag in estimates.flags if flag not in self.flags)
        seen = int(np.bitwise_or.reduce(estimates.status, initial=0))
        for mark in Status:
            self.marks[mark] += int(np.count_nonzero(estimates.status & mark)) if seen & mark else 0
        tracked = (estimates.status & Status.IDLE) == 0
        count = int(np.count_nonzero(tracked))
        if not count:
            return
        rows: Any = tracked if count < len(tracked) else slice(None)
        self.samples += count
        self.nanoseconds += int(np.rint(samples.interval[rows] * 1e9).astype(np.int64).sum())
        self._goes_along(samples.lateral[rows])
        found = estimates
        until = float(samples.time[len(tracked) - 1 - int(np.argmax(tracked[::-1]))])
        tracked &= samples.time >= until - self.keep  # what is older would be forgotten at once
        begin = int(np.argmax(tracked))
        rows = slice(begin, None) if tracked[begin:].all() else tracked
        columns = (found.values, found.std, found.surface, found.surface_std, found.force, found.nis, found.innovation)
        measured = (samples.time, samples.force, samples.position, samples.velocity)
        kept = [column[rows] for column in (*measured, *columns)]
        self._blocks.append(Tail(*kept))
        self._forget(until - self.keep)

    def _goes_along(self, place: Floats) -> None:
        """Take note of the least and the largest of places (n, 2) that are known."""
        with np.errstate(invalid="ignore"):
            edges = np.array([[extreme.reduce(one) for one in place.T] for extreme in (np.fmin, np.fmax)])
        if self._lateral is not None:
            edges = np.array([np.fmin(edges[0], self._lateral[0]), np.fmax(edges[1], self._lateral[1])])
        if np.isfinite(edges).any():
            self._lateral = edges

    @property
    def held(self) -> frozenset[str]:
        """Names of what a fit was told to hold fixed: settings, not estimates."""
        unknowns = self.report.unknowns if self.report else {}
        return frozenset(name for name, unknown in unknowns.items() if not unknown.free)

    @property
    def is_sweep(self) -> bool:
        """Whether the track was at places further apart than a palpation needs; not where nobody says."""
        return self._lateral is not None and float(np.nanmax([0.0, *(self._lateral[1] - self._lateral[0])])) > SWEEP

    @property
    def tracked(self) -> float:
        """How long the track has tracked [s]."""
        return self.nanoseconds / 1e9

    def _forget(self, before: float) -> None:
        while len(self._blocks) > 1 and self._blocks[0].time[-1] < before:
            self._blocks.pop(0)

    def ends(self, average: float) -> tuple[Tail, Tail] | None:
        """The tail, and of it the last so many seconds; None where there are no numbers that could be used."""
        tail = self.tail
        if tail is None or self.marks[Status.DIVERGED] or self.failure is not None:
            return None
        return tail, tail.since(float(tail.time[-1]) - average)

    @property
    def tail(self) -> Tail | None:
        """The last seconds of tracked samples; None where nothing was tracked."""
        if not self._blocks:
            return None
        if len(self._blocks) > 1:  # joined once: a live run asks every second
            names = Tail.__dataclass_fields__
            joined = Tail(*(np.concatenate([getattr(block, name) for block in self._blocks]) for name in names))
            self._blocks = [joined.since(float(joined.time[-1]) - self.keep)]
        return self._blocks[0].since(float(self._blocks[0].time[-1]) - self.keep)
