"""Profile-likelihood intervals: how far an unknown can go while all others make up for it."""

from __future__ import annotations

import numpy as np
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.unknowns import Unknowns

_SAMPLES = 4000
_EVALUATIONS = 25
_MAX_REACH = 1e6  # first steps, of the search for an upper end (choice)
_END_ROUNDING = 0.02  # of the way to an upper end; a bound is printed with two digits


class ProfileIntervals:
    """Intervals of single unknowns around a minimum, on a thinned record whose own minimum they are moved from."""

    def __init__(
        self, residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction
    ) -> None:
        self._residual, self._loss = residual, loss
        self._record = record if residual.model.memory else record.thinned(_SAMPLES)
        self._samples = len(record)
        self._free = list(residual.free)
        self._low, self._high = unknowns.bounds(self._free)
        self._given = x[self._free]
        self._x = x.copy()
        self._minimum, self._cost = self._descend(self._given, None)
        self._inverse = scaled_inverse(self._normal(self._minimum)[1:, 1:])

    def interval(self, place: int, std: float, quantile: float) -> tuple[float, float] | None:
        """Both ends of the interval of the free unknown at a place, or None where they are not found.

        They are where the cost has risen by t^2/2 of what it rises by for one standard uncertainty `std` of correlated
        residuals: the likelihood's shape, calibrated by the residual's real scatter.
        """
        j = self._free.index(place)
        variance = self._inverse[j, j]
        if not (variance > 0 and std > 0 and np.isfinite(std)):
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            ends = [self._end(j, side, std, quantile, variance) for side in (-1.0, 1.0)]
        if ends[0] is None or ends[1] is None:
            return None
        shift = self._given[j] - self._minimum[j]
        low, high = float(ends[0] + shift), float(ends[1] + shift)
        return max(low, float(self._low[j])), min(high, float(self._high[j]))

    def upper_end(self, place: int, quantile: float, step: float, spread: float) -> float | None:
        """Return the upper end alone, searched from a `step`, where the cost has risen by quantile^2/2 spread^2.

        `spread` [N] is the standard deviation of residuals as if independent: this serves at a minimum without
        curvature. The search triples the step until it is beyond the end, and bisects; None if the cost never rises so.
        """
        value = float(self._given[self._free.index(place)])
        edge = float(self._high[self._free.index(place)])
        inside, reach = 0.0, step
        with np.errstate(over="ignore", invalid="ignore"):
            while self.distance(place, min(value + reach, edge), spread) < quantile:
                if value + reach >= edge or reach > _MAX_REACH * step:
                    return None
                inside, reach = reach, 3.0 * reach
        return value + self._bisected(place, inside, reach, quantile, spread)

    def end_above(self, place: int, limit: float, quantile: float, spread: float) -> float:
        """Return the lower end alone, as `upper_end`; the limit [as the unknown] where the cost rises less up to it."""
        value = float(self._given[self._free.index(place)])
        if value <= limit or self.distance(place, limit, spread) < quantile:
            return limit
        return value + self._bisected(place, 0.0, limit - value, quantile, spread)

    def _bisected(self, place: int, inside: float, outside: float, quantile: float, spread: float) -> float:
        """Return the distance from the value [as the unknown] at which the cost has risen by the quantile."""
        value = float(self._given[self._free.index(place)])
        while abs(outside - inside) > _END_ROUNDING * abs(outside):
            middle = 0.5 * (inside + outside)
            is_inside = self.distance(place, value + middle, spread) < quantile
            inside, outside = (middle, outside) if is_inside else (inside, middle)
        return outside

    def determines(self, place: int) -> bool:
        """Return True if the force depends on the free unknown at a place."""
        j = self._free.index(place)
        return bool(self._inverse[j, j] > 0)

    def distance(self, place: int, value: float, spread: float) -> float:
        """Return the distance of a value from the minimum [standard uncertainties], by the rise of the cost to it.

        `spread` [N] as of `upper_end`.
        """
        held_value = value - self._given[self._free.index(place)] + self._minimum[self._free.index(place)]
        _, cost = self._descend(self._minimum, (self._free.index(place), held_value))
        return float(np.sqrt(2.0 * max(cost - self._cost, 0.0))) / max(self._thinned_spread(spread), 1e-300)

    def _thinned_spread(self, spread: float) -> float:
        """Return the spread [N] that makes the thinned record say as much as the whole one."""
        return spread * float(np.sqrt(len(self._record) / self._samples))

    def with_held(self, place: int, value: float) -> Floats:
        """Return the free unknowns (p,) that fit best where the one at a place has a value."""
        shift = self._given - self._minimum
        j = self._free.index(place)
        found = self._descend(self._minimum, (j, value - shift[j]))[0] + shift
        return np.asarray(np.clip(found, self._low, self._high))

    def _end(self, j: int, side: float, std: float, quantile: float, variance: float) -> float | None:
        """By the secant rule on the signed root of the rise, which is nearly a straight line."""
        start, centre = self._minimum, self._minimum[j]
        before, rise_before, reach = 0.0, 0.0, quantile * std
        for _ in range(8):
            edge = self._low[j] if side < 0 else self._high[j]
            value = centre + side * reach
            if side * (value - edge) >= 0:
                return float(edge)
            start, cost = self._descend(start, (j, value))
            rise = float(np.sqrt(max(2.0 * (cost - self._cost), 0.0) * variance)) / std
            if not np.isfinite(rise) or rise <= rise_before:
                return None
            if abs(rise - quantile) < 2e-3 * quantile:
                return float(value)
            slope = (rise - rise_before) / (reach - before)
            before, rise_before = reach, rise
            reach = float(np.clip(reach + (quantile - rise) / slope, 0.3 * reach, 3.0 * reach))
            if reach < before:
                before, rise_before = 0.0, 0.0
        return None

    def _descend(self, start: Floats, held: tuple[int, float] | None) -> tuple[Floats, float]:
        """Return the minimum and its cost, one unknown held."""
        at = start.copy()
        moving = [i for i in range(len(at)) if held is None or i != held[0]]
        if held is not None:
            # The others move along with the held one as the normal equations say, which is nearly all of the way.
            at = at + self._inverse[:, held[0]] / self._inverse[held[0], held[0]] * (held[1] - at[held[0]])
            at[held[0]] = held[1]
            at = np.clip(at, self._low, self._high)
        rows = np.ix_([0, *(1 + i for i in moving)], [0, *(1 + i for i in moving)])

        def normal(values: Floats) -> Floats:
            at[moving] = values
            return self._normal(at)[rows]

        low, high, gain = self._low[moving], self._high[moving], 1e-7 / max(len(self._record), 1)
        found = least_squares(normal, at[moving], low, high, most=_EVALUATIONS, gain=gain)
        at[moving] = found.x
        return at, found.cost

    def _normal(self, free: Floats) -> Floats:
        self._x[self._free] = free
        return self._residual.normal(self._record, self._x, self._loss)
