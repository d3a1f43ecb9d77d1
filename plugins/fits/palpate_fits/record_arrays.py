"""The samples of a fit, as a residual needs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.local_cubic import local_cubic
from palpate_kit.numerics.tip_travel import noise_of

from palpate_fits.columns.column_table import ColumnTable

PARTS = ("height", "rate", "acceleration", "force", "time", "weight")
COLUMNS = len(PARTS) + 4  # with the history
_GOLDEN_RATIO = 0.6180339887498949  # (sqrt(5) - 1)/2: the fractions of its multiples fill 0 to 1 evenly
_TRANSITION_SHARE = 1e-3  # of the way that the tip goes in contact (choice): 5 um of 5 mm
_MIN_TRAVEL = 1e-12  # [m], in place of a tip that does not move: below any resolution


@dataclass(frozen=True)
class FitRecord:
    """The samples of a fit, each (n,), and what a model with memory needs to know of the sample before."""

    height: Floats  # [m] of the tip
    rate: Floats  # [m/s] of the depth: positive where the height falls
    acceleration: Floats  # [m/s^2] of the depth
    force: Floats  # [N]
    time: Floats  # [s] from the middle
    weight: Floats  # square root of that in the sum of squares; 0 for samples that serve as history alone
    transition: float  # [m] over which contact sets in; far below anything that is measured
    history: Floats | None = None  # (n, 4) interval [s], smooth height, and smooth height and rate of the sample before
    window: int = 1  # samples that a smooth height is made of
    rate_noise: float = 0.0  # [m/s] standard deviation of the noise of the rate, for models with memory
    noise: float | None = None  # [m] of the height, by its third differences; None: not taken yet

    def __len__(self) -> int:
        return len(self.height)

    @property
    def parts(self) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """The columns, as `PARTS` names them."""
        return self.height, self.rate, self.acceleration, self.force, self.time, self.weight

    @cached_property
    def table(self) -> ColumnTable:
        """The parts in the layout of a compiled residual."""
        return ColumnTable(self.parts)

    @cached_property
    def columns(self) -> Floats:
        """(n, 10) the parts and the history, or (n, 6) without history."""
        parts = np.column_stack(self.parts)
        return parts if self.history is None else np.concatenate([parts, self.history], axis=1)

    @cached_property
    def height_noise(self) -> float:
        """Standard deviation [m] of white noise on the height of the samples that count."""
        if not self.used.all():
            return noise_of(self.height[self.used], self.time[self.used])
        return noise_of(self.height, self.time) if self.noise is None else self.noise

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """(n,) samples that count."""
        return self.weight > 0

    def selected(self, rows: NDArray[Any] | slice) -> FitRecord:
        """Return some of the samples, which keep their history."""
        history = None if self.history is None else self.history[rows]
        height, rate, acceleration, force, time, weight = (part[rows] for part in self.parts)
        return FitRecord(
            height,
            rate,
            acceleration,
            force,
            time,
            weight,
            transition=self.transition,
            history=history,
            window=self.window,
            rate_noise=self.rate_noise,
        )

    def with_force(self, force: Floats) -> FitRecord:
        """Return the same motion with another force (n,) [N]."""
        return replace(self, force=force)

    def displaced(self, step: Floats, rate_step: Floats) -> FitRecord:
        """Return the same forces at heights and rates that are displaced (n,) [m], [m/s]; of a record with a history.

        A rate by a symmetric window does not know the noise of its own instant, so that the two are independent.
        """
        history = None if self.history is None else self.history.copy()
        if history is not None:
            smooth = local_cubic(step, self.window) if 1 < self.window <= len(step) else step
            history[:, 1] += smooth
            history[0, 2] += smooth[0]
            history[1:, 2] += smooth[:-1]
        return replace(self, height=self.height + step, rate=self.rate + rate_step, history=history)

    def thinned(self, count: int) -> FitRecord:
        """Return about `count` samples, one from each stretch of equal length.

        The place in the k-th stretch is the fraction of k times the golden ratio, so that no period of the motion meets
        the same phase each time.
        """
        length = len(self) / count
        if length <= 1:
            return self
        if count not in self._thinned:
            stretch = np.arange(count)
            self._thinned[count] = self.selected(((stretch + stretch * _GOLDEN_RATIO % 1.0) * length).astype(int))
        return self._thinned[count]

    @cached_property
    def _thinned(self) -> dict[int, FitRecord]:
        """Thinned records so far, by their number of samples."""
        return {}


def _history(time: Floats, height: Floats, rate: Floats) -> Floats:
    """Return the history (n, 4) of a record; the first sample is its own predecessor, an interval of 0 s before."""
    history = np.zeros((len(height), 4))
    history[1:, 0] = np.diff(time)
    history[:, 1] = height
    history[:1, 2] = height[:1]
    history[1:, 2] = height[:-1]
    history[:1, 3] = rate[:1]
    history[1:, 3] = rate[:-1]
    return history


def make_record(
    columns: Sequence[Floats],
    travel: float | None = None,
    remembers: bool = True,
    smooth: tuple[Floats, int] | None = None,
) -> FitRecord:
    """Return a record from its columns as `PARTS` names them, each (n,); with the history for a model that `remembers`.

    The history is made of `smooth`: heights (n,) [m], and of how many samples each is made; without it, of the heights
    as they were read. Contact sets in over a thousandth of the `travel` [m] in contact, or over the noise of the height
    where that is more, and never over more than a thousandth of all heights.
    """
    height, rate, acceleration, force, time, weight = columns
    n = len(height)
    history_height, window = (height, 1) if smooth is None else smooth
    history = _history(time, history_height, rate) if remembers else None
    # Third differences, of which the noise is made, need four samples.
    noise = noise_of(height, time) if n > 3 else None
    transition = _TRANSITION_SHARE * max(float(np.ptp(height)), _MIN_TRAVEL)
    if travel is not None:
        transition = min(transition, max(_TRANSITION_SHARE * travel, noise or 0.0))
    return FitRecord(
        height=height,
        rate=rate,
        acceleration=acceleration,
        force=force,
        time=time - 0.5 * (time[0] + time[-1]) if n else time,  # about the middle of the record
        weight=weight,
        transition=transition,
        history=history,
        window=window,
        noise=noise,
    )
