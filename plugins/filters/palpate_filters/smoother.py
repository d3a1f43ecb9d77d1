"""The kinematic smoother: the estimate at each sample from the whole record, or from a little later."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

import numpy as np
from palpate import ContactModel, Estimates, Floats, Problem, Samples, Status, Time, Tracker
from palpate_kit.kernel import Kernel, compile_step
from pydantic import Field

from palpate_filters.backward_step import backward_step
from palpate_filters.filter_tracker import PIECE, RecursiveTracker
from palpate_filters.filtered_rows import FilteredRows, OutputStore
from palpate_filters.kinematic_filter import (
    causes,
    filter_start,
    kinematic_process,
    kinematic_recursion,
    noises,
)
from palpate_filters.kinematic_settings import KinematicSettings
from palpate_filters.recursion import ActiveStretch, Recursion, output_layout

_HOPS = 4  # a fixed-lag smoother looks between one lag and one lag and a quarter ahead


class KinematicSmoother(KinematicSettings):
    """The kinematic filter, then Rauch, Tung and Striebel's smoother backwards: for maps, after the motion.

    Estimates are those of the whole stretch of contact; with `lag` they use the samples up to that much later (and up
    to a quarter of it more), which is what a delayed online display would show. The first `start_duration` gets
    estimates, too. At a point it goes several times, each linearised at the states that the one before it found: the
    filter's own linearisations, far off at the beginning, leave it too certain. Defaults are the filter's, except a
    stiffer trend. Sources: Rauch, Tung and Striebel 1965; Bell 1994.
    """

    online: ClassVar[bool] = False

    stiffness_trend: float = Field(
        default=3e-3, ge=0, allow_inf_nan=False, description="density of the first logarithm's trend, in 1/s^3"
    )
    lag: Time | None = Field(default=None, gt=0, description="lag of the smoother; left out: to the end")
    passes: int = Field(
        default=3,
        ge=1,
        le=5,
        description="number of passes forwards and back; one on a sweep, with a lag, and for a model with memory",
    )

    def relinearisations(self, model: ContactModel) -> int:
        """How many passes are linearised at what another found."""
        at_once = self.lag is None and not self.follows_changes and not model.memory
        return self.passes - 1 if at_once else 0

    def start(self, problem: Problem) -> Tracker:
        """A tracker that needs all samples in one block; raises ConfigurationError like the filter."""
        return _SmoothingTracker(self, problem)


class _SmoothingTracker:
    """Forwards with the filter, backwards with the smoother, and again."""

    def __init__(self, settings: KinematicSmoother, problem: Problem) -> None:
        self._settings = settings
        first = kinematic_recursion(settings, problem, with_state=True)
        process = kinematic_process(settings, problem)
        self._states = process.states
        self._place = output_layout(first.parameters, process.states)
        self._backward: Kernel = compile_step(backward_step(process))
        self._stretches: list[ActiveStretch] = []
        self._kept = OutputStore()
        self._known: list[tuple[Floats, Floats]] = []  # times (m,) [s] and smoothed states (m, n) of each stretch

        def heard(stretch: ActiveStretch, outputs: Floats) -> None:
            self._kept.keep(stretch, outputs)
            self._stretches.append(stretch)

        def forward(recursion: Recursion) -> RecursiveTracker:
            return RecursiveTracker(recursion, filter_start(settings, problem), heard, causes(settings))

        self._passes = [forward(first)]
        if again := settings.relinearisations(problem.model):
            recursion = kinematic_recursion(settings, problem, with_state=True, known=self._known_states)
            self._passes += [forward(recursion) for _ in range(again)]

    def run(self, samples: Samples) -> Estimates:
        """Estimates for all samples; see `palpate.Tracker`."""
        estimates = self._pass(self._passes[0], samples)
        for forward in self._passes[1:]:
            again = self._pass(forward, samples)
            if ((again.status & ~estimates.status) & Status.DIVERGED).any():
                break
            estimates = again
        self._stretches.clear()
        self._known.clear()
        return estimates

    def _pass(self, forward: RecursiveTracker, samples: Samples) -> Estimates:
        """Once forwards and back; what is known afterwards are the states of this pass."""
        self._stretches.clear()
        estimates = forward.run(samples)
        self._known.clear()
        begins = [i for i, stretch in enumerate(self._stretches) if stretch.interval[0] == 0.0]
        for first, last in pairwise([*begins, len(self._stretches)]):
            self._smooth(samples, self._stretches[first:last], forward.noise, estimates)
        self._kept.forget()
        return estimates

    def _known_states(self, samples: Samples) -> Floats:
        """States (m, n) by the pass before; NaN where it found none."""
        found = np.full((len(samples), self._states), np.nan)
        for time, states in self._known:
            rows = np.minimum(np.searchsorted(time, samples.time), len(time) - 1)
            same = time[rows] == samples.time
            found[same] = states[rows[same]]
        return found

    def _smooth(
        self,
        block: Samples,
        stretches: list[ActiveStretch],
        noise: tuple[float | None, float | None],
        estimates: Estimates,
    ) -> None:
        place, at = self._place, self._place.at
        rows = slice(stretches[0].rows.start, stretches[-1].rows.stop)
        samples, interval = block[rows], np.concatenate([stretch.interval for stretch in stretches])
        if (estimates.status[rows] & Status.DIVERGED).any():
            return
        whole, last = FilteredRows(stretches, self._kept), len(samples) - 1
        numbers = place.span("values", "force")
        found = np.empty((len(samples), numbers.stop + self._states))
        found[last] = np.hstack([whole.of(last, last + 1, columns) for columns in (numbers, place["mean"])])
        self._backwards(whole, interval, samples, np.array(noises(self._settings, *noise)), found[:-1])
        if not np.isfinite(
            found[:, place.span("values", "variances")]
        ).all():  # where a position is missing, so is the surface above it
            estimates.status[rows] |= np.uint32(Status.DIVERGED)
            return
        if len(self._passes) > 1:
            self._known.append((samples.time, found[:, numbers.stop :].copy()))
        estimates.values[rows] = found[:, place["values"]]
        estimates.std[rows] = np.sqrt(np.maximum(found[:, place["variances"]], 0.0))
        estimates.surface[rows] = samples.position + found[:, at("depth")]
        estimates.surface_std[rows] = np.sqrt(np.maximum(found[:, at("depth_variance")], 0.0))
        estimates.force[rows] = found[:, at("force")]
        pieces = [stretch.surprises for stretch in stretches]
        estimates.nis[rows], estimates.innovation[rows] = map(np.concatenate, zip(*pieces, strict=True))
        estimates.status[rows] &= ~np.uint32(Status.WAITING | Status.IDLE)

    def _backwards(
        self, filtered: FilteredRows, interval: Floats, samples: Samples, settings: Floats, found: Floats
    ) -> None:
        """Write the smoother's output at every sample but the last, and its states there."""
        time, count, columns = samples.time, len(samples) - 1, self._place.span("mean", "covariance")
        if not count:
            return

        def ran(state: Floats, first: int, last: int) -> tuple[Floats, Floats]:
            rows, after = slice(first, last), slice(first + 1, last + 1)
            known = filtered.of(first, last, columns)
            inputs = np.column_stack([known, interval[after], samples.position[rows]])
            state, outputs = self._backward.run(state, inputs[::-1], settings)
            return state, outputs[::-1]

        lag = self._settings.lag
        if lag is None:
            state = filtered.of(count, count + 1, columns)[0]
            for first, last in reversed(list(pairwise([*range(0, count, PIECE), count]))):
                state, found[first:last] = ran(state, first, last)
            return
        hop = lag / _HOPS
        cuts = np.searchsorted(time, np.arange(time[0] + hop, time[-1], hop)).tolist()
        for first, last in pairwise(sorted({0, *cuts, count})):
            end = min(int(np.searchsorted(time, time[last - 1] + lag)), count)
            found[first:last] = ran(filtered.of(end, end + 1, columns)[0], first, end)[1][: last - first]
