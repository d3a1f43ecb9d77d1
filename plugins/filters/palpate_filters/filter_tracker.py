"""The tracker of every recursive filter: starts it, continues it after pauses, reads its outputs."""

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

PIECE = 2000  # samples, a choice (0190): stretches of a listener, which a smoother keeps or computes again
_MAX_OFFSET = 1e-3  # [m], a choice: a touch so far along the surface shows nothing of the height here
_WINDOW_GROWTH = 0.2  # start windows, a choice: the growth of the window after an attempt that failed
# A choice: attempts that may ask for a longer window, which has grown fourfold then; a later one starts in any case.
_PATIENT_ATTEMPTS = 15
_TIME_ROUNDING = 1e-9  # [s], the resolution of time-stamps
_IS_MARKED = 0.5  # between a mark of 0 and one of 1
_DIVERGED = int(Status.DIVERGED)


@dataclass(frozen=True)
class _TouchPiece:
    """Samples of one touch in one block, which wait for a start."""

    samples: Samples
    row: int  # of the first, in its block
    starts_touch: bool


class RecursiveTracker:
    """Runs a compiled step over the active samples, stretch by stretch."""

    def __init__(
        self,
        recursion: Recursion,
        opening: FilterStart | None = None,
        listener: Callable[[ActiveStretch, Floats], None] | None = None,
        details: Mapping[str, Any] | None = None,
    ) -> None:
        """Compile the step of a recursion, which starts by `opening` and whose outputs a `listener` gets.

        `details` are added to every block of estimates.
        """
        from palpate_filters.free_air import FreeAir

        self.recursion = recursion
        self._layout = output_layout(recursion.parameters)
        # Marks, 0 or 1 each: the column of every one with its bit of `Status`, and the slice of all of them, which in
        # an output are adjacent and in the order of MARKS.
        self._status_bits = [(self._layout.at(name), int(bit)) for name, bit in MARKS.items()]
        self._mark_columns = self._layout.span(next(iter(MARKS)), next(reversed(MARKS)))
        self._listener = listener
        self.opening = opening or FilterStart()
        self._kernel = compile_step(recursion.step)
        # The noise that is measured in free air, and the settings of the step that wait for it.
        self._free_air = FreeAir(self.opening.standstill) if self.opening.measure_noise else None
        self.noise: tuple[float | None, float | None] = (None, None)  # of force [N] and velocity [m/s], where measured
        self._settings: Floats | None = None if self._free_air else recursion.settings(None, None)
        # The state after the last sample, and the samples before a start.
        self._carry = Carry(None, np.nan)
        self._waiting: list[_TouchPiece] = []
        self._attempts = 0
        self._active = False
        self._diverged = False
        self._details = dict(details or {})

    def run(self, samples: Samples) -> Estimates:
        """Return the estimates (n,) of a block of samples (n,); blocks continue one another, see `palpate.Tracker`."""
        if len(samples.time) == 1 and self._continues_stretch(samples):
            return self._run_sample(samples)
        estimates = Estimates.idle(samples, self.recursion.parameters)
        for rows in self._stretches(samples):
            self._run_stretch(samples, rows, estimates)
        if len(samples):
            self._learn_noise(samples, len(samples))
            self._active = bool(samples.active[-1])
        return replace(estimates, details=self._details) if self._details else estimates

    def _continues_stretch(self, sample: Samples) -> bool:
        """Return True if a block of one sample continues a stretch."""
        has_started = self._carry.state is not None and self._settings is not None
        return bool(has_started and self._active and sample.active[0] and sample.interval[0] <= PAUSE)

    def _run_sample(self, sample: Samples) -> Estimates:
        """Return the estimates of one sample within a stretch: the numbers of `run`, by plain floats for speed."""
        assert self._carry.state is not None
        assert self._settings is not None
        layout, k = self._layout, self.recursion.parameters
        # The step's output, by the columns of its layout; it has -1 for a missing nis and 0 for a missing innovation.
        row = self._advance(self._carry.state, sample, sample.interval, self._settings, slice(0, 1))[0].tolist()
        status = sum(bit for column, bit in self._status_bits if row[column] > _IS_MARKED)
        self._diverged |= bool(status & _DIVERGED)
        nis, innovation = row[layout.at("nis")], row[layout.at("innovation")]
        numbers = [
            *row[layout["values"]],
            *map(_standard_deviation, row[layout["variances"]]),
            float(sample.position[0]) + row[layout.at("depth")],
            _standard_deviation(row[layout.at("depth_variance")]),
            row[layout.at("force")],
            math.nan if nis < 0 else nis,
            math.nan if innovation == 0 else innovation,
        ]
        if self._diverged:
            numbers, status = [math.nan] * len(numbers), status | _DIVERGED
        # All numbers share one array; each field is a view of its columns: values (k), deviations (k), five scalars.
        table = np.array([numbers])
        scalars = table[0, 2 * k :]
        return Estimates(
            sample.time,
            values=table[:, :k],
            std=table[:, k : 2 * k],
            surface=scalars[0:1],
            surface_std=scalars[1:2],
            force=scalars[2:3],
            nis=scalars[3:4],
            status=np.array([status], np.uint32),
            details=self._details,
            innovation=scalars[4:5],
        )

    def _learn_noise(self, samples: Samples, until: int) -> None:
        """Learn the noise from free air before the first contact."""
        if self._free_air is not None and self._settings is None:
            self._free_air.add(samples[:until])

    def _step_settings(self, samples: Samples, until: int) -> Floats:
        """Return the step's settings; the first call ends the measurement of noise, at a row of the block."""
        if self._settings is None:
            assert self._free_air is not None
            self._learn_noise(samples, until)
            noise = self._free_air.noise()
            self.noise = noise.force, noise.velocity
            self._details |= {"noise": {"force": noise.force, "velocity": noise.velocity, "from": noise.source}}
            self._settings = self.recursion.settings(*self.noise)
        return self._settings

    def _stretches(self, samples: Samples) -> Iterator[slice]:
        """Yield the rows of active samples without a pause between them."""
        active = samples.active
        # The usual case online: the whole block continues.
        if self._active and active.all() and (samples.interval <= PAUSE).all():
            if len(active):
                yield slice(0, len(active))
            return
        # A stretch begins where contact does, or after a pause, and ends with the contact.
        previous = np.concatenate([[self._active], active[:-1]])
        begins = active & (~previous | (samples.interval > PAUSE))
        cuts = np.flatnonzero(begins | (active != previous))
        for first, last in zip([0, *cuts], [*cuts, len(active)], strict=True):
            if first < last and active[first]:
                yield slice(int(first), int(last))

    def _run_stretch(self, samples: Samples, rows: slice, estimates: Estimates) -> None:
        """Run the filter over some rows of a block, after its start if that is due, and write their estimates."""
        part = samples[rows] if rows != slice(0, len(samples)) else samples
        settings = self._step_settings(samples, rows.start)
        continued = self._active if rows.start == 0 else bool(samples.active[rows.start - 1])
        begins = not continued or part.interval[0] > PAUSE
        if self._carry.state is None and self.opening.window > 0:
            self._wait_for_start(part, rows, begins, settings, estimates)
            return
        # A new stretch begins from the last one's end, without a prediction over the pause.
        interval = part.interval.copy()
        state, resumed = self._carry.state, False
        if state is None or begins:
            interval[0] = 0.0
            # patient=False: the recursion gives a state for any first sample.
            begun = self.recursion.begin(self._carry, part[:1], False)
            assert begun is not None
            state, resumed = begun
        outputs = self._advance(state, part, interval, settings, rows)
        self._write(outputs, part, estimates, rows)
        if resumed:
            estimates.status[rows.start] |= np.uint32(Status.RESUMED)

    def _advance(self, state: Floats, part: Samples, interval: Floats, settings: Floats, rows: slice) -> Floats:
        """Return the outputs of some samples from a state, and keep the state after them."""
        inputs = self.recursion.inputs(part, interval)
        if self._listener is None:
            state, outputs = self._kernel.run(state, inputs, settings)
        else:
            state, outputs = self._run_pieces(self._listener, state, inputs, interval, settings, row=rows.start)
        self._carry = Carry(state, float(part.position[-1] + outputs[-1, self._layout.at("depth")]))
        return outputs

    def _run_pieces(
        self,
        listener: Callable[[ActiveStretch, Floats], None],
        state: Floats,
        inputs: Floats,
        interval: Floats,
        settings: Floats,
        row: int,
    ) -> tuple[Floats, Floats]:
        """Return the state after, and outputs of, a part that begins at a row; a listener gets it piece by piece.

        `inputs` (n, columns) are the step's samples, `interval` (n,) [s] their times since the samples before.
        """
        # Means and covariances go to the listener alone: of all samples they would take a kilobyte each.
        reported = np.empty((len(inputs), self._layout.size))
        for first in range(0, len(inputs), PIECE):
            piece = slice(first, first + PIECE)
            # A listener that does not keep the outputs of a piece calls this to compute them again.
            again = partial(self._kernel.run, state, inputs[piece], settings)
            state, outputs = again()
            rows = _row_slice(row + first, len(outputs))
            listener(ActiveStretch(rows, interval[piece], surprises(outputs, self._layout), again), outputs)
            reported[piece] = outputs[:, : self._layout.size]
        return state, reported

    def _wait_for_start(
        self, part: Samples, rows: slice, starts_touch: bool, settings: Floats, estimates: Estimates
    ) -> None:
        """Hold samples until there are enough to start on; then run over them, and report only those of this block.

        `part` are the samples of some `rows` of the block, of which `starts_touch` says that a contact begins with
        them. Samples of a touch elsewhere on the surface are dropped: its height is another one here.
        """
        if starts_touch and self._waiting and _is_elsewhere(self._waiting[-1].samples, part):
            self._waiting, self._attempts = [], 0
        held_count = sum(len(piece.samples) for piece in self._waiting)
        self._waiting.append(_TouchPiece(part, rows.start, starts_touch))
        estimates.status[rows] |= np.uint32(Status.WAITING)
        start = self._try_start(Samples.joined([piece.samples for piece in self._waiting]))
        if start is None:
            return
        # The sample that completes the window is the first with an estimate.
        state, last_row = start
        first = last_row - held_count  # its row in `part`
        first_rows = slice(rows.start + first, rows.start + first + 1)
        outputs = self._run_waiting(state, last_row + 1, settings)
        self._waiting = []
        self._write(outputs[-1:], part[first : first + 1], estimates, first_rows, unreported=outputs)
        # The samples after it.
        if first + 1 < len(part):
            later, later_rows = part[first + 1 :], slice(first_rows.stop, rows.stop)
            assert self._carry.state is not None
            outputs = self._advance(self._carry.state, later, later.interval, settings, later_rows)
            self._write(outputs, later, estimates, later_rows)

    def _run_waiting(self, state: Floats, count: int, settings: Floats) -> Floats:
        """Return the outputs of the first `count` samples that were held, touch by touch, from a first state."""
        outputs: list[Floats] = []
        for piece in self._waiting:
            samples = piece.samples[:count]
            count -= len(samples)
            interval = samples.interval.copy()
            # A further touch begins from the last one's end, without a prediction over the pause.
            if piece.starts_touch:
                interval[0] = 0.0
                if outputs:
                    begun = self.recursion.begin(self._carry, samples[:1], False)
                    assert begun is not None
                    state = begun[0]
            rows = _row_slice(piece.row, len(samples))
            outputs.append(self._advance(state, samples, interval, settings, rows))
            assert self._carry.state is not None
            state = self._carry.state
        return np.concatenate(outputs)

    def _try_start(self, held: Samples) -> tuple[Floats, int] | None:
        """Return the first state and the row of the last sample it is from; None while the samples do not suffice.

        `held` are all samples that wait. The window that a start needs counts the time in contact, so that touches
        which are each too short add up. It grows by a fifth of its first length after every attempt that fails.
        """
        # The time in contact, without the way from one touch to the next.
        piece_ends = np.cumsum([len(piece.samples) for piece in self._waiting])
        time_in_contact = held.time - held.time[0]
        for row, piece in zip(piece_ends[:-1].tolist(), self._waiting[1:], strict=True):
            if piece.starts_touch:
                time_in_contact[row:] -= held.time[row] - held.time[row - 1]
        while True:
            window = self.opening.window * (1.0 + _WINDOW_GROWTH * self._attempts)
            last_row = int(np.searchsorted(time_in_contact, window - _TIME_ROUNDING))
            if last_row >= len(held):
                return None
            is_patient = self._attempts < _PATIENT_ATTEMPTS
            begun = self.recursion.begin(self._carry, held[: last_row + 1], is_patient)
            if begun is not None:
                state, _ = begun  # a first start resumes nothing
                return state, last_row
            self._attempts += 1

    def _write(
        self, outputs: Floats, part: Samples, estimates: Estimates, rows: slice, unreported: Floats | None = None
    ) -> None:
        """Write outputs as estimates of some rows; after a divergence they are NaN.

        `unreported` are outputs of earlier samples, of which only a divergence counts.
        """
        layout, column = self._layout, self._layout.at
        # One bit of the status for each of the marks.
        status = np.zeros(len(outputs), np.uint32)
        marked = outputs[:, self._mark_columns] > _IS_MARKED
        if marked.any():
            for is_marked, bit in zip(marked.T, MARKS.values(), strict=True):
                status[is_marked] |= np.uint32(bit)
        if unreported is not None:
            self._diverged |= bool((unreported[:, column("diverged")] > _IS_MARKED).any())
        # A filter that has diverged stays so.
        diverged = (status & _DIVERGED > 0) | self._diverged
        if diverged.any():
            diverged = np.logical_or.accumulate(diverged)
            self._diverged = True
            status[diverged] |= np.uint32(_DIVERGED)
        # The estimates, by the outputs' columns.
        nis, innovation = surprises(outputs, layout)
        columns = {
            "values": outputs[:, layout["values"]],
            "std": np.sqrt(np.maximum(outputs[:, layout["variances"]], 0.0)),
            "surface": part.position + outputs[:, column("depth")],
            "surface_std": np.sqrt(np.maximum(outputs[:, column("depth_variance")], 0.0)),
            "force": outputs[:, column("force")],
            "nis": nis,
            "innovation": innovation,
        }
        for name, numbers in columns.items():
            getattr(estimates, name)[rows] = numbers
            if self._diverged:
                getattr(estimates, name)[rows][diverged] = np.nan
        estimates.status[rows] = status


def _standard_deviation(variance: float) -> float:
    """Return the root of a variance; 0 where rounding has made it negative, NaN without a number."""
    return 0.0 if variance <= 0 else math.sqrt(variance)


def _row_slice(first: int, count: int) -> slice:
    """Return `count` rows from the first."""
    return slice(first, first + count)


def _is_elsewhere(before: Samples, after: Samples) -> bool:
    """Return True if a touch is at another place than the one before it; False where the places are unknown."""
    return bool(np.linalg.norm(after.lateral[0] - before.lateral[-1]) > _MAX_OFFSET)
