"""The tracker of every recursive filter: starts it, carries it over pauses, reads its outputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from palpate import Estimates, Floats, Samples, Status
from palpate_kit.kernel import compile_step

from palpate_filters.recursion import MARKS, ActiveStretch, Carry, FilterStart, Recursion, output_layout, surprises
from palpate_filters.starting_fit import PAUSE

PIECE = 2000  # samples that a listener hears of at once
_ELSEWHERE = 1e-3  # [m] along the surface: a touch there says nothing of the height here
_FIRST, _DIVERGED = slice(0, 1), int(Status.DIVERGED)
_ATTEMPTS = 15  # to start on a window, which has grown fourfold by then


@dataclass(frozen=True)
class _PausedFilter:
    """Samples that wait for a start."""

    samples: Samples
    row: int  # of the first, in its block
    touch: bool  # a touch begins with them


class RecursiveTracker:
    """Runs a compiled step over the active samples, stretch by stretch."""

    def __init__(
        self,
        recursion: Recursion,
        opening: FilterStart | None = None,
        listener: Callable[[ActiveStretch, Floats], None] | None = None,
        details: Mapping[str, Any] | None = None,
    ) -> None:
        from palpate_filters.free_air import FreeAir

        self.recursion = recursion
        self._place = output_layout(recursion.parameters)
        self._marks = [(self._place.at(name), int(mark)) for name, mark in MARKS.items()]
        self._marked = self._place.span(next(iter(MARKS)), next(reversed(MARKS)))
        self._listener = listener
        self.opening = opening or FilterStart()
        self._kernel = compile_step(recursion.step)
        self._free_air = FreeAir(self.opening.standstill) if self.opening.measure_noise else None
        self.noise: tuple[float | None, float | None] = (None, None)  # of force [N] and velocity [m/s], where measured
        self._settings: Floats | None = None if self._free_air else recursion.settings(None, None)
        self._carry = Carry(None, np.nan)
        self._gathered: list[_PausedFilter] = []
        self._attempts = 0
        self._active = False
        self._diverged = False
        self._details = dict(details or {})

    def run(self, samples: Samples) -> Estimates:
        """The estimates (n,) of a block of samples (n,); blocks continue one another, see `palpate.Tracker`."""
        if len(samples.time) == 1 and self._goes_on(samples):
            return self._one(samples)
        estimates = Estimates.idle(samples, self.recursion.parameters)
        for rows in self._stretches(samples):
            self._run_stretch(samples, rows, estimates)
        if len(samples):
            self._listen(samples, len(samples))
            self._active = bool(samples.active[-1])
        return replace(estimates, details=self._details) if self._details else estimates

    def _goes_on(self, sample: Samples) -> bool:
        """Whether a block of one sample continues a stretch."""
        known = self._carry.state is not None and self._settings is not None
        return bool(known and self._active and sample.active[0] and sample.interval[0] <= PAUSE)

    def _one(self, sample: Samples) -> Estimates:
        """What `run` says of one sample within a stretch: the same numbers, in plain floats."""
        assert self._carry.state is not None
        assert self._settings is not None
        place, k = self._place, self.recursion.parameters
        row = self._advance(self._carry.state, sample, sample.interval, self._settings, _FIRST)[0].tolist()
        status = sum(mark for at, mark in self._marks if row[at] > 0.5)
        self._diverged |= bool(status & _DIVERGED)
        nis, innovation = row[place.at("nis")], row[place.at("innovation")]
        numbers = [
            *row[place["values"]],
            *map(_root, row[place["variances"]]),
            float(sample.position[0]) + row[place.at("depth")],
            _root(row[place.at("depth_variance")]),
            row[place.at("force")],
            math.nan if nis < 0 else nis,
            math.nan if innovation == 0 else innovation,
        ]
        if self._diverged:
            numbers, status = [math.nan] * len(numbers), status | _DIVERGED
        found = np.array([numbers])
        values, std, rest = found[:, :k], found[:, k : 2 * k], found[0, 2 * k :]
        surface, surface_std, force, nis_, innovation_ = (rest[i : i + 1] for i in range(5))
        marks = np.array([status], np.uint32)
        return Estimates(
            sample.time, values, std, surface, surface_std, force, nis_, marks, self._details, (), innovation_
        )

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
            self._details |= {"noise": {"force": found.force, "velocity": found.velocity, "from": found.source}}
            self._settings = self.recursion.settings(*self.noise)
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
        if self._carry.state is None and self.opening.window > 0:
            self._gather(part, rows, begins, settings, estimates)
            return
        interval = part.interval.copy()
        state, resumed = self._carry.state, False
        if state is None or begins:
            interval[0] = 0.0
            begun = self.recursion.begin(self._carry, part[:1], False)
            assert begun is not None
            state, resumed = begun
        outputs = self._advance(state, part, interval, settings, rows)
        self._write(outputs, part, estimates, rows)
        if resumed:
            estimates.status[rows.start] |= np.uint32(Status.RESUMED)

    def _advance(self, state: Floats, part: Samples, interval: Floats, settings: Floats, rows: slice) -> Floats:
        inputs = self.recursion.inputs(part, interval)
        if self._listener is None:
            state, outputs = self._kernel.run(state, inputs, settings)
        else:
            state, outputs = self._listened(self._listener, state, inputs, interval, settings, rows.start)
        self._carry = Carry(state, float(part.position[-1] + outputs[-1, self._place.at("depth")]))
        return outputs

    def _listened(
        self,
        listener: Callable[[ActiveStretch, Floats], None],
        state: Floats,
        inputs: Floats,
        interval: Floats,
        settings: Floats,
        row: int,
    ) -> tuple[Floats, Floats]:
        """State after, and outputs of, a part that begins at a row; a listener hears of it piece by piece."""
        states = np.empty((len(inputs), self._place.size))  # states of all samples would take a kilobyte each
        for first in range(0, len(inputs), PIECE):
            piece = slice(first, first + PIECE)
            again = partial(self._kernel.run, state, inputs[piece], settings)
            state, outputs = again()
            rows = _rows(row + first, len(outputs))
            listener(ActiveStretch(rows, interval[piece], surprises(outputs, self._place), again), outputs)
            states[piece] = outputs[:, : self._place.size]
        return state, states

    def _gather(self, part: Samples, rows: slice, begins: bool, settings: Floats, estimates: Estimates) -> None:
        """Hold samples until there are enough to start on; then run over them, and report only the present."""
        if begins and self._gathered and _elsewhere(self._gathered[-1].samples, part):
            self._gathered, self._attempts = [], 0
        held = sum(len(piece.samples) for piece in self._gathered)
        self._gathered.append(_PausedFilter(part, rows.start, begins))
        estimates.status[rows] |= np.uint32(Status.WAITING)
        found = self._opened(Samples.joined([piece.samples for piece in self._gathered]))
        if found is None:
            return
        state, ready = found
        start = ready - held
        here = slice(rows.start + start, rows.start + start + 1)
        outputs = self._caught_up(state, ready + 1, settings)
        self._gathered = []
        self._write(outputs[-1:], part[start : start + 1], estimates, here, before=outputs)
        if start + 1 < len(part):
            rest, after = part[start + 1 :], slice(here.stop, rows.stop)
            assert self._carry.state is not None
            outputs = self._advance(self._carry.state, rest, rest.interval, settings, after)
            self._write(outputs, rest, estimates, after)

    def _caught_up(self, state: Floats, count: int, settings: Floats) -> Floats:
        """Outputs of the first so many samples that were held, touch by touch."""
        outputs: list[Floats] = []
        for piece in self._gathered:
            samples, count = piece.samples[:count], count - len(piece.samples[:count])
            interval = samples.interval.copy()
            if piece.touch:
                interval[0] = 0.0
                if outputs:
                    begun = self.recursion.begin(self._carry, samples[:1], False)
                    assert begun is not None
                    state = begun[0]
            outputs.append(self._advance(state, samples, interval, settings, _rows(piece.row, len(samples))))
            assert self._carry.state is not None
            state = self._carry.state
        return np.concatenate(outputs)

    def _opened(self, whole: Samples) -> tuple[Floats, int] | None:
        """First state and its row, as soon as a window is long and informative enough; windows grow by fifths.

        What counts is the time in contact: touches that are each too short add up.
        """
        lengths = np.cumsum([len(piece.samples) for piece in self._gathered])
        begins = [int(row) for row, piece in zip(lengths[:-1], self._gathered[1:], strict=True) if piece.touch]
        elapsed = whole.time - whole.time[0]
        for row in begins:
            elapsed[row:] -= whole.time[row] - whole.time[row - 1]
        while True:
            due = self.opening.window * (1.0 + 0.2 * self._attempts)
            ready = int(np.searchsorted(elapsed, due - 1e-9))
            if ready >= len(whole):
                return None
            begun = self.recursion.begin(self._carry, whole[: ready + 1], self._attempts < _ATTEMPTS)
            if begun is not None:
                return begun[0], ready
            self._attempts += 1

    def _write(
        self, outputs: Floats, part: Samples, estimates: Estimates, rows: slice, before: Floats | None = None
    ) -> None:
        place, at = self._place, self._place.at
        status = np.zeros(len(outputs), np.uint32)
        marked = outputs[:, self._marked] > 0.5
        for column, mark in zip(marked.T, MARKS.values(), strict=True) if marked.any() else ():
            status[column] |= np.uint32(mark)
        if before is not None:  # what went wrong without a report
            self._diverged |= bool((before[:, at("diverged")] > 0.5).any())
        broken = (status & _DIVERGED > 0) | self._diverged
        if broken.any():
            broken = np.logical_or.accumulate(broken)
            self._diverged = True
            status[broken] |= np.uint32(_DIVERGED)
        nis, innovation = surprises(outputs, place)
        columns = {
            "values": outputs[:, place["values"]],
            "std": np.sqrt(np.maximum(outputs[:, place["variances"]], 0.0)),
            "surface": part.position + outputs[:, at("depth")],
            "surface_std": np.sqrt(np.maximum(outputs[:, at("depth_variance")], 0.0)),
            "force": outputs[:, at("force")],
            "nis": nis,
            "innovation": innovation,
        }
        for name, found in columns.items():
            getattr(estimates, name)[rows] = found
            if self._diverged:
                getattr(estimates, name)[rows][broken] = np.nan
        estimates.status[rows] = status


def _root(variance: float) -> float:
    """Standard deviation; 0 where rounding has left less than none, NaN without a number."""
    return 0.0 if variance <= 0 else math.sqrt(variance)


def _rows(first: int, count: int) -> slice:
    return slice(first, first + count)


def _elsewhere(before: Samples, after: Samples) -> bool:
    """Whether a touch is at another place than the one before it, as far as this is known."""
    return bool(np.linalg.norm(after.lateral[0] - before.lateral[-1]) > _ELSEWHERE)
