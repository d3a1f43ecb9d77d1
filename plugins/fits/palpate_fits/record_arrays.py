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
COLUMNS = len(PARTS) + 4
_GOLDEN = 0.6180339887498949  # its multiples fill the interval from 0 to 1 evenly
_TRANSITION = 1e-3  # of the way that the tip goes in contact


@dataclass(frozen=True)
class FitRecord:
    """The samples of a fit, each (n,), and what a model with memory needs to know of the sample before."""

    height: Floats  # [m]
    rate: Floats  # [m/s]
    acceleration: Floats  # [m/s^2]
    force: Floats  # [N]
    time: Floats  # [s] from the middle
    weight: (
        Floats  # square root of the weight in the sum of squares; 0 for samples that are only there for their history
    )
    transition: float  # [m] over which contact sets in; far below anything that is measured
    history: Floats | None = None  # (n, 4) interval [s], smooth height, and smooth height and rate of the sample before
    window: int = 1  # samples that a smooth height is made of
    rate_noise: float = 0.0  # [m/s] standard deviation of the noise of the rate, for models with memory
    noise: float | None = None  # [m] of the height, by its third differences; None: not taken yet

    def __len__(self) -> int:
        return len(self.height)

    @property
    def parts(self) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """As `PARTS` names them."""
        return self.height, self.rate, self.acceleration, self.force, self.time, self.weight

    @cached_property
    def table(self) -> ColumnTable:
        """The parts as a compiled residual reads them."""
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
        """Some of the samples, which keep their history."""
        history = None if self.history is None else self.history[rows]
        height, rate, acceleration, force, time, weight = (part[rows] for part in self.parts)
        return FitRecord(
            height, rate, acceleration, force, time, weight, self.transition, history, self.window, self.rate_noise
        )

    def with_force(self, force: Floats) -> FitRecord:
        """Return the same motion with another force (n,) [N]."""
        return replace(self, force=force)

    def displaced(self, step: Floats, rate_step: Floats) -> FitRecord:
        """The same forces at heights and rates that are other by so much (n,) [m], [m/s]; of a record with a history.

        A rate by a symmetric window does not know the noise of its own instant, so that the two are independent.
        """
        history = None if self.history is None else self.history.copy()
        if history is not None:
            smooth = local_cubic(step, self.window) if 1 < self.window <= len(step) else step
            history[:, 1] += smooth
            history[0, 2] += smooth[0]
            history[1:, 2] += smooth[:-1]
        return replace(self, height=self.height + step, rate=self.rate + rate_step, history=history)

    def thinned(self, most: int) -> FitRecord:
        """About `most` samples, one from each stretch of equal length, at places that no period of a motion shares."""
        step = len(self) / most
        if step <= 1:
            return self
        if most not in self._thinned:
            order = np.arange(most)
            self._thinned[most] = self.selected(((order + order * _GOLDEN % 1.0) * step).astype(int))
        return self._thinned[most]

    @cached_property
    def _thinned(self) -> dict[int, FitRecord]:
        return {}


def make_record(
    columns: Sequence[Floats],
    travel: float | None = None,
    remembers: bool = True,
    smooth: tuple[Floats, int] | None = None,
) -> FitRecord:
    """Return a record from its columns as `PARTS` names them, each (n,); with what a model that `remembers` needs.

    It remembers the motion by `smooth`: heights (n,) [m], and of how many samples each is made; left out: the heights
    as they are. Contact sets in over a thousandth of the `travel` [m] in contact, or over the noise of the height where
    that is more, and never over more than a thousandth of all heights.
    """
    height, rate, acceleration, force, time, weight = columns
    n, history = len(height), None
    if remembers:
        remembered = height if smooth is None else smooth[0]
        history = np.zeros((n, 4))
        history[:, 1] = remembered
        history[:1, 2], history[:1, 3] = remembered[:1], rate[:1]
        history[1:, 0], history[1:, 2], history[1:, 3] = np.diff(time), remembered[:-1], rate[:-1]
    centred = time - 0.5 * (time[0] + time[-1]) if n else time
    whole = _TRANSITION * max(float(np.ptp(height)), 1e-12)
    noise = noise_of(height, time) if n > 3 else 0.0
    transition = whole if travel is None else min(whole, max(_TRANSITION * travel, noise))
    return FitRecord(
        height, rate, acceleration, force, centred, weight, transition, history, 1 if smooth is None else smooth[1],
        noise=noise if n > 3 else None,
    )  # fmt: skip
