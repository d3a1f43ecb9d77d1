"""Estimates along the way of a tip that moved sideways: a track's estimates at all places, not at the last one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from palpate import BudgetRow, ContactModel, Estimates, Floats, Samples, Status, finite_rows
from palpate_engine import DerivedValue, TrackResult, UncertainValue

_PLACE = 1e-3  # [m] of one place (decision 0127)
_WARM_UP = 1.0  # [s] from the first estimate that do not count (decision 0127)
_ENDS = (0.01, 0.99)  # quantiles, between which a range goes (decision 0127)
_CAUSE = "places"
_ATTRIBUTES_OF_MEAN = {"estimator": "std", "settling": "settling"}  # of a value, by the budget's row


@dataclass
class PathEstimates:
    """The latest estimate at every place of 1 mm; the same ones however a record is cut into blocks."""

    _places: dict[tuple[int, int], tuple[float, Floats]] = field(default_factory=dict)  # time [s], and the numbers
    _begin: float = math.nan  # [s] of the first estimate
    last: Floats = field(default_factory=lambda: np.zeros(0))  # (columns,) the latest numbers

    def add(self, time: Floats, place: Floats, numbers: Floats) -> None:
        """Add estimates (n, columns) at times (n,) [s] and places (n, 2) [m]; those of no place are left out.

        The columns are the parameters, their standard deviations, the surface and its deviation. A place, a cell of
        1 mm, gets the latest estimate before the tip leaves it.
        """
        rows = finite_rows(place)
        if not rows.any():
            return
        time, numbers = time[rows], numbers[rows]
        # The latest estimate in each cell before the next cell, or the end of the block.
        cells = np.rint(place[rows] / _PLACE).astype(np.int64)
        if math.isnan(self._begin):
            self._begin = float(time[0])
        self.last = numbers[-1].copy()
        leaving = np.append((cells[1:] != cells[:-1]).any(axis=1), True)
        for row in np.flatnonzero(leaving).tolist():
            self._places[int(cells[row, 0]), int(cells[row, 1])] = (float(time[row]), numbers[row].copy())

    @property
    def numbers(self) -> Floats:
        """The numbers (places, columns) of all places after the warm-up; of all places where none is after it."""
        visits = [self._places[place] for place in sorted(self._places)]
        warm = [numbers for time, numbers in visits if time >= self._begin + _WARM_UP]
        return np.array(warm or [numbers for _, numbers in visits])


class Places:
    """The summary of a track that is a sweep; a fit is one of the whole record as it is."""

    def __init__(self) -> None:
        self._way = PathEstimates()

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """See `palpate_engine.TrackSummary`."""
        if not finite_rows(samples.lateral).any():
            return  # the tip's place is not known
        is_tracked = ((estimates.status & Status.IDLE) == 0) & finite_rows(estimates.values)
        columns = (estimates.values, estimates.std, estimates.surface, estimates.surface_std)
        self._way.add(samples.time[is_tracked], samples.lateral[is_tracked], np.column_stack(columns)[is_tracked])

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """See `palpate_engine.TrackSummary`."""
        return place_means(result, model, self._way) if is_sweep and result.report is None else result


def place_means(result: TrackResult, model: ContactModel, way: PathEstimates) -> TrackResult:
    """Return the result with means over the places of 1 mm in place of the last sample, which stays as ``last``.

    `way` has the estimates by places. The standard deviation is that of one place, as the estimator gives it; how the
    places differ is a cause of uncertainty of its own, so that the combined one holds for any of them.
    """
    numbers, names, count = way.numbers, list(result.parameters), len(model.parameters)
    if not len(numbers) or not all(math.isfinite(value.value) for value in result.parameters.values()):
        return result
    # Columns are the parameters, their standard deviations, the surface, and its standard deviation.
    values, last = numbers[:, :count], way.last
    parameters = {}
    for i, name in enumerate(names):
        columns = [i, count + i]
        parameters[name] = _over_places(result.parameters[name], numbers[:, columns], last[columns])
    effects = {name: value.effect(value.budget.get(_CAUSE, 0.0)) for name, value in parameters.items()}
    return replace(
        result,
        parameters=parameters,
        derived=tuple(_derived(value, model, values, last[:count]) for value in result.derived),
        surface=_over_places(result.surface, numbers[:, -2:], last[-2:]),
        budget=(*(_rescaled(row, parameters) for row in result.budget), BudgetRow(_CAUSE, None, "", effects)),
    )


def _over_places(of_record: UncertainValue, numbers: Floats, last: Floats) -> UncertainValue:
    """Return a value as its mean over places, from the value and deviation at each (n, 2) and at the last sample (2,).

    What else is known of the value of the whole record is taken over.
    """
    values, std = numbers.T
    mean = float(values.mean())
    low, middle, high = np.quantile(values, [_ENDS[0], 0.5, _ENDS[1]]).tolist()
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    places = {"places": len(values), "low": low, "median": middle, "high": high, "spread": spread}
    # Its shear modulus changes in proportion; settling and bias are of the last sample, and not of a mean.
    per_shear = of_record.per_shear
    if per_shear is not None:
        per_shear = per_shear * mean / of_record.value if of_record.value else None
    typical_std = float(np.sqrt((std**2).mean()))
    over = replace(of_record, value=mean, std=typical_std, settling=0.0, per_shear=per_shear, bias=None)
    at_the_end = {"value": float(last[0]), "std": float(last[1])}
    return replace(over.diagnosed(_CAUSE, spread), places=places, last=at_the_end)


def _derived(derived: DerivedValue, model: ContactModel, values: Floats, last: Floats) -> DerivedValue:
    """Return a value that is derived from the parameters, place by place."""

    def value_and_std(row: Floats) -> tuple[float, float]:
        value_by_name: dict[str, float] = {material.name: material.value for material in model.material(row.tolist())}
        return value_by_name[derived.name], derived.found.std

    numbers = np.array([value_and_std(row) for row in values])
    return replace(derived, found=_over_places(derived.found, numbers, np.array(value_and_std(last))))


def _rescaled(row: BudgetRow, parameters: Mapping[str, UncertainValue]) -> BudgetRow:
    """Return the row of a budget for the mean: those of estimator and settling change, all others stay."""
    attribute = _ATTRIBUTES_OF_MEAN.get(row.source)
    if attribute is None:
        return row
    effects = {name: value.effect(getattr(value, attribute)) for name, value in parameters.items()}
    return replace(row, effects=effects)
