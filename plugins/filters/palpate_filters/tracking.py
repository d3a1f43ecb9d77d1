"""The tracker of a filter on the inertial process: carries it over pauses, reads its outputs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, Samples, Status, Step, compile_step

Floats = NDArray[np.float64]

_PAUSE = 0.02  # [s]; over a longer one the measured position carries the depth, not the process
_RESUME_STD = 1e-4  # [m], what such a carry-over adds to the uncertainty of the depth
_MARKS = (Status.LIFTED, Status.RESTARTED, Status.BLIND, Status.STIFF, Status.DIVERGED)


class InertialTracker:
    """Runs a compiled step over the active samples, stretch by stretch."""

    def __init__(self, step: Step, settings: Floats, start: Floats, start_std: Floats, parameters: int) -> None:
        self._parameters = parameters  # the last of the states; before them depth, rate and the model's internal ones
        self._kernel = compile_step(step)
        self._settings = settings
        self._start, self._start_std = start, start_std
        self._state: Floats | None = None
        self._surface = np.nan  # [m], by the latest estimate
        self._active = False
        self._diverged = False

    def run(self, samples: Samples) -> Estimates:
        """Estimates for a block; see `palpate.Tracker`."""
        estimates = Estimates.idle(samples, self._parameters)
        for rows in self._stretches(samples):
            self._run_stretch(samples, rows, estimates)
        if len(samples):
            self._active = bool(samples.active[-1])
        return estimates

    def _stretches(self, samples: Samples) -> Iterator[slice]:
        """Rows of active samples without a pause between them."""
        active = samples.active
        previous = np.concatenate([[self._active], active[:-1]])
        begins = active & (~previous | (samples.interval > _PAUSE))
        cuts = np.flatnonzero(begins | (active != previous))
        for first, last in zip([0, *cuts], [*cuts, len(active)], strict=True):
            if first < last and active[first]:
                yield slice(int(first), int(last))

    def _run_stretch(self, samples: Samples, rows: slice, estimates: Estimates) -> None:
        part = samples[rows]
        interval = part.interval.copy()
        continued = self._active if rows.start == 0 else bool(samples.active[rows.start - 1])
        resumed = False
        if self._state is None or not continued or interval[0] > _PAUSE:
            interval[0] = 0.0
            resumed = self._begin(float(part.position[0]), -float(part.velocity[0]))
        assert self._state is not None
        inputs = np.column_stack([part.force, -part.velocity, interval])
        self._state, outputs = self._kernel.run(self._state, inputs, self._settings)
        self._write(outputs, part, estimates, rows)
        if resumed:
            estimates.status[rows.start] |= np.uint32(Status.RESUMED)

    def _begin(self, position: float, rate: float) -> bool:
        """Start afresh, or carry the last estimate over a pause by the measured position; True in this case."""
        n = len(self._start)
        depth = self._surface - position
        resumed = self._state is not None and depth > 0
        mean, covariance = self._start.copy(), np.diag(self._start_std**2)
        if resumed:
            assert self._state is not None
            mean[2:] = self._state[2:n]
            before = self._state[n : n + n * n].reshape(n, n)
            covariance[2:, 2:] = before[2:, 2:]
            mean[0], covariance[0, 0] = depth, before[0, 0] + _RESUME_STD**2
        mean[1] = rate if np.isfinite(rate) else 0.0
        self._state = np.concatenate([mean, covariance.ravel(), [0.0, 0.0]])
        return resumed

    def _write(self, outputs: Floats, part: Samples, estimates: Estimates, rows: slice) -> None:
        n = len(self._start)
        marks = outputs[:, 2 * n + 2 :] > 0.5
        status = np.zeros(len(outputs), np.uint32)
        for column, mark in enumerate(_MARKS):
            status[marks[:, column]] |= np.uint32(mark)
        broken = np.logical_or.accumulate(marks[:, -1] | self._diverged)
        self._diverged = bool(broken[-1])
        status[broken] |= np.uint32(Status.DIVERGED)
        variance = np.maximum(outputs[:, n : 2 * n], 0.0)
        nis = outputs[:, 2 * n + 1]
        columns = {
            "values": outputs[:, n - self._parameters : n],
            "std": np.sqrt(variance[:, n - self._parameters :]),
            "surface": part.position + outputs[:, 0],
            "surface_std": np.sqrt(variance[:, 0]),
            "force": outputs[:, 2 * n],
            "nis": np.where(nis < 0, np.nan, nis),
        }
        for name, found in columns.items():
            found[broken] = np.nan
            getattr(estimates, name)[rows] = found
        estimates.status[rows] = status
        self._surface = float(estimates.surface[rows][-1])
