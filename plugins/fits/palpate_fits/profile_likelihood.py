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

_SAMPLES = 4000  # of the thinned record (choice: time)
_MAX_EVALUATIONS = 25  # of a minimum with one unknown held (choice)
_INDEPENDENT_GAIN = 1e-7  # of the cost, over the samples: 3e-4 standard deviations from the minimum
_MAX_SECANTS = 8  # to an end of an interval (choice)
_END_TOLERANCE = 2e-3  # of the quantile, at an end (choice)
_MIN_SECANT_STEP, _MAX_SECANT_STEP = 0.3, 3.0  # of the distance so far, in one step (choice)
_SEARCH_FACTOR = 3.0  # from one step of the search for an upper end to the next (choice)
_MAX_REACH = 1e6  # first steps, of the search for an upper end (choice)
_END_ROUNDING = 0.02  # of the way to an upper end; a bound is printed with two digits
_SMALLEST_SPREAD = 1e-300  # [N] in a quotient, in place of 0: near the smallest double


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
        self._estimate = x[self._free]
        self._x = x.copy()
        self._minimum, self._cost = self._descend(self._estimate, None)
        self._inverse = scaled_inverse(self._normal(self._minimum)[1:, 1:])

    def interval(self, place: int, std: float, quantile: float) -> tuple[float, float] | None:
        """Return both ends of the interval of the free unknown at a place, or None where they are not found.

        With t the `quantile` of Student's distribution, the cost has risen there by t^2 std^2/(2 V_jj): t^2 times its
        rise at one standard uncertainty `std`, if the cost were the parabola of the normal equations, of inverse V.
        `std` allows for correlated residuals: the likelihood's shape, calibrated by the residual's real scatter.
        """
        j = self._free.index(place)
        variance = self._inverse[j, j]
        if not (variance > 0 and std > 0 and np.isfinite(std)):
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            ends = [self._end(j, side, std, quantile, variance) for side in (-1.0, 1.0)]
        if ends[0] is None or ends[1] is None:
            return None
        shift = self._estimate[j] - self._minimum[j]  # of the whole record against the thinned one
        low, high = float(ends[0] + shift), float(ends[1] + shift)
        return max(low, float(self._low[j])), min(high, float(self._high[j]))

    def upper_end(self, place: int, quantile: float, step: float, spread: float) -> float | None:
        """Return the upper end alone, searched from a `step`, where the cost has risen by quantile^2/2 spread^2.

        `spread` [N] is the standard deviation of residuals as if independent: this serves at a minimum without
        curvature. The search triples the step until it is beyond the end, and bisects; None if the cost never rises so.
        """
        value = float(self._estimate[self._free.index(place)])
        edge = float(self._high[self._free.index(place)])
        inside, reach = 0.0, step
        with np.errstate(over="ignore", invalid="ignore"):
            while self.distance(place, min(value + reach, edge), spread) < quantile:
                if value + reach >= edge or reach > _MAX_REACH * step:
                    return None
                inside, reach = reach, _SEARCH_FACTOR * reach
        return value + self._bisected(place, inside, reach, quantile, spread)

    def end_above(self, place: int, limit: float, quantile: float, spread: float) -> float:
        """Return the lower end alone, as `upper_end`; the limit [as the unknown] where the cost rises less up to it."""
        value = float(self._estimate[self._free.index(place)])
        if value <= limit or self.distance(place, limit, spread) < quantile:
            return limit
        return value + self._bisected(place, 0.0, limit - value, quantile, spread)

    def _bisected(self, place: int, inside: float, outside: float, quantile: float, spread: float) -> float:
        """Return the distance from the value [as the unknown] at which the cost has risen by the quantile."""
        value = float(self._estimate[self._free.index(place)])
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
        j = self._free.index(place)
        held_value = value - self._estimate[j] + self._minimum[j]
        _, cost = self._descend(self._minimum, (j, held_value))
        rise = float(np.sqrt(2.0 * max(cost - self._cost, 0.0)))
        return rise / max(self._thinned_spread(spread), _SMALLEST_SPREAD)

    def _thinned_spread(self, spread: float) -> float:
        """Return the spread [N] that makes the thinned record say as much as the whole one."""
        return spread * float(np.sqrt(len(self._record) / self._samples))

    def with_held(self, place: int, value: float) -> Floats:
        """Return the free unknowns (p,) that fit best where the one at a place has a value."""
        shift = self._estimate - self._minimum
        j = self._free.index(place)
        conditional, _ = self._descend(self._minimum, (j, value - shift[j]))
        return np.asarray(np.clip(conditional + shift, self._low, self._high))

    def _end(self, j: int, side: float, std: float, quantile: float, variance: float) -> float | None:
        """Return the end of the j-th unknown's interval on a side (-1 or 1), or its bound; None where none is found.

        The end is where the distance z(v) = sqrt(2 (C(v) - C_min) V_jj)/std, C(v) the cost with the unknown held at v
        and V the inverse of the normal equations, is the quantile. z is nearly a straight line, and is solved for by
        the secant rule.
        """
        start, centre = self._minimum, self._minimum[j]
        bound = self._low[j] if side < 0 else self._high[j]
        previous_reach, previous_distance, reach = 0.0, 0.0, quantile * std
        for _ in range(_MAX_SECANTS):
            value = centre + side * reach
            if side * (value - bound) >= 0:
                return float(bound)
            start, cost = self._descend(start, (j, value))
            distance = float(np.sqrt(max(2.0 * (cost - self._cost), 0.0) * variance)) / std
            if not np.isfinite(distance) or distance <= previous_distance:
                return None
            if abs(distance - quantile) < _END_TOLERANCE * quantile:
                return float(value)
            slope = (distance - previous_distance) / (reach - previous_reach)
            previous_reach, previous_distance = reach, distance
            next_reach = reach + (quantile - distance) / slope
            reach = float(np.clip(next_reach, _MIN_SECANT_STEP * reach, _MAX_SECANT_STEP * reach))
            # A step back: the next secant is from the minimum.
            if reach < previous_reach:
                previous_reach, previous_distance = 0.0, 0.0
        return None

    def _descend(self, start: Floats, held: tuple[int, float] | None) -> tuple[Floats, float]:
        """Return the free unknowns (p,) of least cost near a start, and that cost.

        `held` is the index of an unknown among them, and the value at which it is held; None if none is.
        """
        free = start.copy()
        moving = [i for i in range(len(free)) if held is None or i != held[0]]
        if held is not None:
            # The others move along with the held one as the normal equations say, which is nearly all of the way.
            j, value = held
            free = free + self._inverse[:, j] / self._inverse[j, j] * (value - free[j])
            free[j] = value
            free = np.clip(free, self._low, self._high)
        rows = np.ix_([0, *(1 + i for i in moving)], [0, *(1 + i for i in moving)])

        def normal(values: Floats) -> Floats:
            free[moving] = values
            return self._normal(free)[rows]

        gain = _INDEPENDENT_GAIN / max(len(self._record), 1)
        low, high = self._low[moving], self._high[moving]
        minimum = least_squares(normal, free[moving], low, high, most=_MAX_EVALUATIONS, gain=gain)
        free[moving] = minimum.x
        return free, minimum.cost

    def _normal(self, free: Floats) -> Floats:
        """Return [r, J]^T [r, J] (1 + p, 1 + p) of the thinned record."""
        self._x[self._free] = free
        return self._residual.normal(self._record, self._x, self._loss)
