"""The kinematic smoother: what the whole record says of each of its samples, or what is known a little later."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar

import numpy as np
from palpate import Estimates, Floats, Problem, Samples, Status, Time, Tracker
from pydantic import Field

from palpate_filters.backward_step import backward_step
from palpate_filters.kernel import Kernel, compile_step
from palpate_filters.kinematic_filter import (
    kinematic_process,
    kinematic_recursion,
    known_causes,
    noises,
    opening,
)
from palpate_filters.kinematic_settings import KinematicSettings
from palpate_filters.recursion import Stretch, output_layout, surprises
from palpate_filters.tracking import RecursiveTracker

_BLOCK = 2048  # samples that are smoothed at once
_HOPS = 4  # a fixed-lag smoother looks between one lag and one lag and a quarter ahead


class KinematicSmoother(KinematicSettings):
    """The kinematic filter, then Rauch, Tung and Striebel's smoother backwards: for maps, after the motion.

    Estimates are those of the whole stretch of contact; with `lag` they use the samples up to that much later (and up
    to a quarter of it more), which is what a delayed online display would show. The first `start_duration` gets
    estimates, too. Defaults are the filter's, except a stiffer trend. Source: Rauch, Tung and Striebel 1965.
    """

    online: ClassVar[bool] = False

    stiffness_trend: float = Field(
        default=3e-3, ge=0, allow_inf_nan=False, description="density of the first logarithm's trend, in 1/s^3"
    )
    lag: Time | None = Field(default=None, gt=0, description="how far ahead it looks; left out: to the end")

    def start(self, problem: Problem) -> Tracker:
        """A tracker that wants all samples in one block; raises ConfigurationError like the filter."""
        return _SmoothingTracker(self, problem)


class _SmoothingTracker:
    """Forwards with the filter, backwards with the smoother."""

    def __init__(self, settings: KinematicSmoother, problem: Problem) -> None:
        self._settings = settings
        self._recursion = kinematic_recursion(settings, problem, with_state=True)
        self._opening = opening(settings, problem)
        process = kinematic_process(settings, problem)
        self._place = output_layout(self._recursion.parameters, process.states)
        self._backward: Kernel = compile_step(backward_step(process))
        self._passages: list[Stretch] = []
        self._forward = RecursiveTracker(self._recursion, self._opening, self._passages.append, known_causes(settings))

    def run(self, samples: Samples) -> Estimates:
        """Estimates for all samples; see `palpate.Tracker`."""
        self._passages.clear()
        estimates = self._forward.run(samples)
        for first, last in self._runs():
            self._smooth(self._passages[first:last], estimates)
        self._passages.clear()
        return estimates

    def _runs(self) -> list[tuple[int, int]]:
        """First and last passage of each stretch: a stretch begins with an interval of 0."""
        begins = [i for i, passage in enumerate(self._passages) if passage.interval[0] == 0.0]
        return list(pairwise([*begins, len(self._passages)]))

    def _smooth(self, passages: list[Stretch], estimates: Estimates) -> None:
        place, at = self._place, self._place.at
        samples = Samples.joined([passage.samples for passage in passages])
        interval = np.concatenate([passage.interval for passage in passages])
        rows = slice(passages[0].rows.start, passages[-1].rows.stop)
        if (estimates.status[rows] & Status.DIVERGED).any():
            return
        whole = _Rows([passage.outputs for passage in passages])
        found = whole.of(0, len(samples), place.span("values", "force")).copy()
        self._backwards(whole, interval, samples, found[:-1])
        if not np.isfinite(
            found[:, place.span("values", "variances")]
        ).all():  # where a position is missing, so is the surface above it
            estimates.status[rows] |= np.uint32(Status.DIVERGED)
            return
        estimates.values[rows] = found[:, place["values"]]
        estimates.std[rows] = np.sqrt(np.maximum(found[:, place["variances"]], 0.0))
        estimates.surface[rows] = samples.position + found[:, at("depth")]
        estimates.surface_std[rows] = np.sqrt(np.maximum(found[:, at("depth_variance")], 0.0))
        estimates.force[rows] = found[:, at("force")]
        pieces = [surprises(passage.outputs, place) for passage in passages]
        estimates.nis[rows], estimates.innovation[rows] = map(np.concatenate, zip(*pieces, strict=True))
        estimates.status[rows] &= ~np.uint32(Status.WAITING | Status.IDLE)

    def _backwards(self, filtered: _Rows, interval: Floats, samples: Samples, found: Floats) -> None:
        """Write what the smoother says of every sample but the last."""
        settings, time = np.array(noises(self._settings, *self._forward.noise)), samples.time
        count, columns = len(samples) - 1, self._place.span("mean", "covariance")
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
            for first, last in reversed(list(pairwise([*range(0, count, _BLOCK), count]))):
                state, found[first:last] = ran(state, first, last)
            return
        hop = lag / _HOPS
        cuts = np.searchsorted(time, np.arange(time[0] + hop, time[-1], hop)).tolist()
        for first, last in pairwise(sorted({0, *cuts, count})):
            end = min(int(np.searchsorted(time, time[last - 1] + lag)), count)
            found[first:last] = ran(filtered.of(end, end + 1, columns)[0], first, end)[1][: last - first]


class _Rows:
    """Rows of arrays (n, m) one after the other, which are too many to be joined."""

    def __init__(self, parts: Sequence[Floats]) -> None:
        self._parts = parts
        self._begins = np.cumsum([0, *map(len, parts)]).tolist()

    def of(self, first: int, last: int, columns: slice) -> Floats:
        """Some columns of the rows from first to last."""
        pairs = zip(self._parts, pairwise(self._begins), strict=True)
        pieces = [part[max(first - begin, 0) : last - begin, columns] for part, (begin, end) in pairs
                  if begin < last and first < end]  # fmt: skip
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
