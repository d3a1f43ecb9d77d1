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

_HOPS_PER_LAG = 4  # a choice (0106): a fixed-lag smoother uses between one lag and one lag and a quarter of the future


class KinematicSmoother(KinematicSettings):
    """The kinematic filter, then Rauch, Tung and Striebel's smoother backwards: for maps, after the motion.

    Estimates are those of the whole stretch of contact; with `lag` they use the samples up to that much later (and up
    to a quarter of it more), which is what a delayed online display would show. The first `start_duration` gets
    estimates, too. At a point it runs several times, each linearised at the smoothed states of the pass before: the
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
        """Return the number of passes that are linearised at the states of another."""
        is_repeatable = self.lag is None and not self.follows_changes and not model.memory
        return self.passes - 1 if is_repeatable else 0

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker that needs all samples in one block; raises ConfigurationError like the filter."""
        return _SmoothingTracker(self, problem)


class _SmoothingTracker:
    """Forwards with the filter, backwards with the smoother, and again."""

    def __init__(self, settings: KinematicSmoother, problem: Problem) -> None:
        """Compile the filter, the step backwards, and the filter that is linearised at smoothed states.

        `problem` has the model and the tip's mass.
        """
        self._settings = settings
        first = kinematic_recursion(settings, problem, with_state=True)
        process = kinematic_process(settings, problem)
        self._states = process.states
        self._place = output_layout(first.parameters, process.states)
        self._backward: Kernel = compile_step(backward_step(process))
        self._stretches: list[ActiveStretch] = []
        self._kept = OutputStore()
        self._smoothed: list[tuple[Floats, Floats]] = []  # times (m,) [s] and smoothed states (m, n) of each stretch

        def keep(stretch: ActiveStretch, outputs: Floats) -> None:
            """Keep the outputs of a stretch for the way back."""
            self._kept.keep(stretch, outputs)
            self._stretches.append(stretch)

        def forward(recursion: Recursion) -> RecursiveTracker:
            """Return a tracker that runs a recursion and keeps its outputs."""
            return RecursiveTracker(recursion, filter_start(settings, problem), keep, causes(settings))

        # The first pass, and those that are linearised at the smoothed states of the pass before.
        self._passes = [forward(first)]
        repetitions = settings.relinearisations(problem.model)
        if repetitions:
            recursion = kinematic_recursion(settings, problem, with_state=True, known=self._smoothed_states)
            self._passes += [forward(recursion) for _ in range(repetitions)]

    def run(self, samples: Samples) -> Estimates:
        """Return estimates for all samples; see `palpate.Tracker`."""
        estimates = self._run_pass(self._passes[0], samples)
        for forward in self._passes[1:]:
            repeated = self._run_pass(forward, samples)
            # A pass that diverges where the one before did not is dropped.
            if ((repeated.status & ~estimates.status) & Status.DIVERGED).any():
                break
            estimates = repeated
        self._stretches.clear()
        self._smoothed.clear()
        return estimates

    def _run_pass(self, forward: RecursiveTracker, samples: Samples) -> Estimates:
        """Run once forwards and back; the states of this pass replace those of the pass before."""
        self._stretches.clear()
        estimates = forward.run(samples)
        self._smoothed.clear()
        # A touch is smoothed as a whole: it begins where its interval is 0.
        begins = [i for i, stretch in enumerate(self._stretches) if stretch.interval[0] == 0.0]
        for first, last in pairwise([*begins, len(self._stretches)]):
            self._smooth(samples, self._stretches[first:last], forward.noise, estimates)
        self._kept.forget()
        return estimates

    def _smoothed_states(self, samples: Samples) -> Floats:
        """Return the states (m, n) of the pass before; NaN where it has none."""
        linearisation = np.full((len(samples), self._states), np.nan)
        for time, states in self._smoothed:
            rows = np.minimum(np.searchsorted(time, samples.time), len(time) - 1)
            same = time[rows] == samples.time
            linearisation[same] = states[rows[same]]
        return linearisation

    def _smooth(
        self,
        block: Samples,
        stretches: list[ActiveStretch],
        noise: tuple[float | None, float | None],
        estimates: Estimates,
    ) -> None:
        """Smooth one touch, and write its estimates; one that diverges keeps the filter's marks alone.

        `stretches` of the touch follow one another in the rows of `block`. `noise` is that of force [N] and velocity
        [m/s] where it was measured.
        """
        layout = self._place
        rows = slice(stretches[0].rows.start, stretches[-1].rows.stop)
        if (estimates.status[rows] & Status.DIVERGED).any():
            return
        samples = block[rows]
        smoothed = self._smoothed_rows(samples, stretches, noise)
        # Where a position is missing, so is the surface above it; parameters and variances are never missing.
        if not np.isfinite(smoothed[:, layout.span("values", "variances")]).all():
            estimates.status[rows] |= np.uint32(Status.DIVERGED)
            return
        if len(self._passes) > 1:
            self._smoothed.append((samples.time, smoothed[:, layout.span("values", "force").stop :].copy()))
        estimates.values[rows] = smoothed[:, layout["values"]]
        estimates.std[rows] = np.sqrt(np.maximum(smoothed[:, layout["variances"]], 0.0))
        estimates.surface[rows] = samples.position + smoothed[:, layout.at("depth")]
        estimates.surface_std[rows] = np.sqrt(np.maximum(smoothed[:, layout.at("depth_variance")], 0.0))
        estimates.force[rows] = smoothed[:, layout.at("force")]
        # Innovations are the filter's.
        surprises = [stretch.surprises for stretch in stretches]
        estimates.nis[rows], estimates.innovation[rows] = map(np.concatenate, zip(*surprises, strict=True))
        estimates.status[rows] &= ~np.uint32(Status.WAITING | Status.IDLE)

    def _smoothed_rows(
        self, samples: Samples, stretches: list[ActiveStretch], noise: tuple[float | None, float | None]
    ) -> Floats:
        """Return the reported numbers and the state (m, numbers + n) at each sample of a touch."""
        filtered, last = FilteredRows(stretches, self._kept), len(samples) - 1
        interval = np.concatenate([stretch.interval for stretch in stretches])
        numbers = self._place.span("values", "force")
        smoothed = np.empty((len(samples), numbers.stop + self._states))
        # At the last sample the smoother's estimate is the filter's.
        columns = (numbers, self._place["mean"])
        smoothed[last] = np.hstack([filtered.of(last, last + 1, part) for part in columns])
        settings = np.array(noises(self._settings, *noise))
        self._run_backwards(filtered, interval, samples, settings, smoothed[:-1])
        return smoothed

    def _run_backwards(
        self, filtered: FilteredRows, interval: Floats, samples: Samples, settings: Floats, smoothed: Floats
    ) -> None:
        """Write the smoother's output, states included, at every sample but the last, where it is the filter's.

        `filtered` has the filter's outputs by rows, `smoothed` (N, columns) is written to.
        """
        time, count, columns = samples.time, len(samples) - 1, self._place.span("mean", "covariance")
        if not count:
            return

        def run_rows(state: Floats, first: int, last: int) -> tuple[Floats, Floats]:
            """Return the state after running backwards from row `last` to `first`, and the outputs in between."""
            rows, after = slice(first, last), slice(first + 1, last + 1)
            estimates = filtered.of(first, last, columns)
            inputs = np.column_stack([estimates, interval[after], samples.position[rows]])
            state, outputs = self._backward.run(state, inputs[::-1], settings)
            return state, outputs[::-1]

        # To the end: once over all samples, piece by piece, from the filter's last state.
        lag = self._settings.lag
        if lag is None:
            state = filtered.of(count, count + 1, columns)[0]
            for first, last in reversed(list(pairwise([*range(0, count, PIECE), count]))):
                state, smoothed[first:last] = run_rows(state, first, last)
            return
        # With a lag: each hop from the filter's state one lag after its end.
        hop = lag / _HOPS_PER_LAG
        cuts = np.searchsorted(time, np.arange(time[0] + hop, time[-1], hop)).tolist()
        for first, last in pairwise(sorted({0, *cuts, count})):
            end = min(int(np.searchsorted(time, time[last - 1] + lag)), count)
            state = filtered.of(end, end + 1, columns)[0]
            smoothed[first:last] = run_rows(state, first, end)[1][: last - first]
