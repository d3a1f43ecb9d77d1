"""The tracker of every recursive filter: starts it, carries it over pauses, reads its outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, Samples, Status, Step, compile_step

Floats = NDArray[np.float64]

PAUSE = 0.02  # [s]; over a longer one the measured position carries the depth, not the process
_MARKS = (Status.LIFTED, Status.RESTARTED, Status.BLIND, Status.STIFF, Status.DIVERGED, Status.REPAIRED)
_ATTEMPTS = 15  # to start on a window, which has grown fourfold by then
_DIVERGED = _MARKS.index(Status.DIVERGED)


@dataclass(frozen=True)
class Carry:
    """What is left of a stretch of contact when the next one begins."""

    state: Floats | None  # the filter's; None before the first stretch
    surface: float  # [m], by the latest estimate


@dataclass(frozen=True)
class Recursion:
    """A filter as its tracker needs it.

    The step's output: parameters (k), their variances (k), depth below the surface by the measured position [m], its
    variance, contact force [N], NIS (negative where nothing was measured), the normalised innovation of one measurement
    (0 where it is missing), and 0/1 for depth not positive, restarted, a measurement missing, too stiff, broken
    numbers, covariance repaired.
    """

    step: Step
    parameters: int
    settings: Callable[[float | None, float | None], Floats]  # from force and velocity noise, where measured
    # State for a stretch, and whether it resumes the last one; None where it wants a longer window, and may (True).
    begin: Callable[[Carry, Samples, bool], tuple[Floats, bool] | None]
    inputs: Callable[[Samples, Floats], Floats]  # the step's samples (m, nw), from samples and their intervals


@dataclass(frozen=True)
class Opening:
    """How a filter gets under way."""

    window: float = 0.0  # [s] of samples gathered before the first estimate
    measure_noise: bool = False
    rest: float | None = None  # [s] at the beginning of the record in which the tip is known to be at rest


@dataclass(frozen=True)
class Passage:
    """What a filter did on samples without a pause between them."""

    rows: slice  # in the block
    samples: Samples
    interval: Floats  # (m,) [s], 0 at the first of a stretch
    outputs: Floats  # (m, ny)


class RecursiveTracker:
    """Runs a compiled step over the active samples, stretch by stretch."""

    def __init__(
        self,
        recursion: Recursion,
        opening: Opening | None = None,
        listener: Callable[[Passage], None] | None = None,
    ) -> None:
        from palpate_filters.free_air import FreeAir

        self._recursion = recursion
        self._listener = listener
        self._opening = opening or Opening()
        self._kernel = compile_step(recursion.step)
        self._free_air = FreeAir(self._opening.rest) if self._opening.measure_noise else None
        self.noise: tuple[float | None, float | None] = (None, None)  # of force [N] and velocity [m/s], where measured
        self._settings: Floats | None = None if self._free_air else recursion.settings(None, None)
        self._carry = Carry(None, np.nan)
        self._gathered: list[Samples] = []
        self._attempts = 0
        self._active = False
        self._diverged = False
        self._details: dict[str, Any] = {}

    def run(self, samples: Samples) -> Estimates:
        """Estimates for a block; see `palpate.Tracker`."""
        estimates = Estimates.idle(samples, self._recursion.parameters)
        for rows in self._stretches(samples):
            self._run_stretch(samples, rows, estimates)
        if len(samples):
            self._listen(samples, len(samples))
            self._active = bool(samples.active[-1])
        return replace(estimates, details=self._details) if self._details else estimates

    def _listen(self, samples: Samples, until: int) -> None:
        """Learn the noise from free air before the first contact."""
        if self._free_air is not None and self._settings is None:
            self._free_air.add(samples[:until])

    def _numbers(self, samples: Samples, until: int) -> Floats:
        if self._settings is None:
            assert self._free_air is not None
            self._listen(samples, until)
            found = self._free_air.noise()
            self.noise = found.force, found.velocity
            self._details = {"noise": {"force": found.force, "velocity": found.velocity, "from": found.source}}
            self._settings = self._recursion.settings(*self.noise)
        return self._settings

    def _stretches(self, samples: Samples) -> Iterator[slice]:
        """Rows of active samples without a pause between them."""
        active = samples.active
        if self._active and active.all() and (samples.interval <= PAUSE).all():  # as it nearly always is online
            if len(active):
                yield slice(0, len(active))
            return
        previous = np.concatenate([[self._active], active[:-1]])
        begins = active & (~previous | (samples.interval > PAUSE))
        cuts = np.flatnonzero(begins | (active != previous))
        for first, last in zip([0, *cuts], [*cuts, len(active)], strict=True):
            if first < last and active[first]:
                yield slice(int(first), int(last))

    def _run_stretch(self, samples: Samples, rows: slice, estimates: Estimates) -> None:
        part = samples[rows] if rows != slice(0, len(samples)) else samples
        settings = self._numbers(samples, rows.start)
        continued = self._active if rows.start == 0 else bool(samples.active[rows.start - 1])
        begins = not continued or part.interval[0] > PAUSE
        if self._carry.state is None and self._opening.window > 0:
            self._gather(part, rows, begins, settings, estimates)
            return
        interval = part.interval.copy()
        state, resumed = self._carry.state, False
        if state is None or begins:
            interval[0] = 0.0
            begun = self._recursion.begin(self._carry, part[:1], False)
            assert begun is not None
            state, resumed = begun
        outputs = self._advance(state, part, interval, settings, rows)
        self._write(outputs, part, estimates, rows)
        if resumed:
            estimates.status[rows.start] |= np.uint32(Status.RESUMED)

    def _advance(self, state: Floats, part: Samples, interval: Floats, settings: Floats, rows: slice) -> Floats:
        state, outputs = self._kernel.run(state, self._recursion.inputs(part, interval), settings)
        k = self._recursion.parameters
        self._carry = Carry(state, float(part.position[-1] + outputs[-1, 2 * k]))
        if self._listener is not None:
            self._listener(Passage(rows, part, interval, outputs))
        return outputs

    def _gather(self, part: Samples, rows: slice, begins: bool, settings: Floats, estimates: Estimates) -> None:
        """Hold samples until there are enough to start on; then run over them, and tell only what is now."""
        if begins:
            self._gathered, self._attempts = [], 0
        held = sum(len(block) for block in self._gathered)
        self._gathered.append(part)
        whole = Samples.joined(self._gathered)
        estimates.status[rows] |= np.uint32(Status.WAITING)
        found = self._opened(whole)
        if found is None:
            return
        state, ready = found
        self._gathered = []
        start, window = ready - held, whole[: ready + 1]
        interval = window.interval.copy()
        interval[0] = 0.0
        here = slice(rows.start + start, rows.start + start + 1)
        outputs = self._advance(state, window, interval, settings, slice(here.stop - len(window), here.stop))
        self._write(outputs[-1:], part[start : start + 1], estimates, here, before=outputs)
        if start + 1 < len(part):
            rest, after = part[start + 1 :], slice(here.stop, rows.stop)
            assert self._carry.state is not None
            outputs = self._advance(self._carry.state, rest, rest.interval, settings, after)
            self._write(outputs, rest, estimates, after)

    def _opened(self, whole: Samples) -> tuple[Floats, int] | None:
        """First state and its row, as soon as a window is long and telling enough; windows grow by fifths."""
        elapsed = whole.time - whole.time[0]
        while True:
            due = self._opening.window * (1.0 + 0.2 * self._attempts)
            ready = int(np.searchsorted(elapsed, due - 1e-9))
            if ready >= len(whole):
                return None
            begun = self._recursion.begin(self._carry, whole[: ready + 1], self._attempts < _ATTEMPTS)
            if begun is not None:
                return begun[0], ready
            self._attempts += 1

    def _write(
        self, outputs: Floats, part: Samples, estimates: Estimates, rows: slice, before: Floats | None = None
    ) -> None:
        k = self._recursion.parameters
        marks = outputs[:, 2 * k + 5 : 2 * k + 5 + len(_MARKS)] > 0.5
        status = np.zeros(len(outputs), np.uint32)
        for column, mark in enumerate(_MARKS):
            status[marks[:, column]] |= np.uint32(mark)
        if before is not None:  # what went wrong while nobody was told
            self._diverged |= bool((before[:, 2 * k + 5 + _DIVERGED] > 0.5).any())
        broken = np.logical_or.accumulate(marks[:, _DIVERGED] | self._diverged)
        self._diverged = bool(broken[-1])
        status[broken] |= np.uint32(Status.DIVERGED)
        nis = outputs[:, 2 * k + 3]
        columns = {
            "values": outputs[:, :k],
            "std": np.sqrt(np.maximum(outputs[:, k : 2 * k], 0.0)),
            "surface": part.position + outputs[:, 2 * k],
            "surface_std": np.sqrt(np.maximum(outputs[:, 2 * k + 1], 0.0)),
            "force": outputs[:, 2 * k + 2],
            "nis": np.where(nis < 0, np.nan, nis),
            "innovation": np.where(outputs[:, 2 * k + 4] == 0, np.nan, outputs[:, 2 * k + 4]),
        }
        for name, found in columns.items():
            found = np.array(found)
            found[broken] = np.nan
            getattr(estimates, name)[rows] = found
        estimates.status[rows] = status
