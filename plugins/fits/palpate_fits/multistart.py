"""Several starts, for models whose cost has more than one minimum: those with a time of relaxation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from palpate import Flag, Floats
from palpate_kit.numerics.refusal import NotFitted

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import PARTS, FitRecord, make_record
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution, solve_lm, solve_trf
from palpate_fits.unknowns import EXTRAS, Unknowns

# Choices, of the search from several starts.
_GRID_TIMES = 6  # of each relaxation time, evenly in its logarithm
_COARSE_SAMPLES = 1500  # of the record that is searched on
_SHORTEST_TIME = 2.0  # [sample intervals] of the relaxation times that are tried
_LONGEST_TIME = 0.5  # [lengths of the record] of the relaxation times that are tried
_MAX_TIME_RATIO = 10.0  # [lengths of the record], beyond which a relaxation does not show
_ROUGH_EVALUATIONS = 15  # of each start
_VISCOSITY_FACTORS = (0.1, 1.0, 10.0)
_FINISHED_STARTS = 2  # that are followed to their minimum
_START_GAIN = 1e-9  # of the cost, below which a step towards the minimum near a start is the last one
# Choices, of another minimum.
_PLAUSIBLE_SIGMAS = 3.0  # within which it describes the record as well
_DISTINCT_SHARE = 0.25  # of a value, by which it is another one
_LAW_STD_SHARE = 0.5  # of a model's law_error, as its standard uncertainty


def times_of(unknowns: Unknowns) -> list[int]:
    """Return the places of the free relaxation times of a model."""
    return [i for i in unknowns.free if unknowns.items[i].unit == "s" and unknowns.items[i].name not in EXTRAS]


def with_times_that_show(unknowns: Unknowns, record: FitRecord) -> Unknowns:
    """Return the unknowns with relaxation times from the interval of the samples to ten times the record's length.

    Beyond either end the record is that of a model without the relaxation, which a flag says: at a bound.
    """
    low = _sample_interval(record)
    high = _MAX_TIME_RATIO * _duration(record)
    for place in times_of(unknowns):
        item = unknowns.items[place]
        if max(low, item.lower) < min(high, item.upper):
            unknowns = unknowns.changed(item.name, lower=max(low, item.lower), upper=min(high, item.upper))
    return unknowns


def solve_from_many(
    residual_of: Callable[[tuple[int, ...]], Residual],
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
) -> Solution:
    """Return the best minimum from a grid of relaxation times, the other unknowns fitted for each of them first.

    `residual_of` gives the residual whose free unknowns are at some places. The grid is searched on a coarser record;
    the best few are followed to their minimum on the whole one.
    """
    times = times_of(unknowns)
    others = tuple(place for place in unknowns.free if place not in times)
    coarse = _coarse(record)
    # The others at each point of the grid, roughly.
    rough_fits: list[Solution] = []
    for values in product(*(_time_grid(unknowns, place, coarse) for place in times)):
        start = x.copy()
        start[times] = values
        rough_fit = solve_trf(
            residual=residual_of(others),
            unknowns=unknowns,
            record=coarse,
            x=start,
            loss=loss,
            max_evaluations=_ROUGH_EVALUATIONS,
        )
        if np.isfinite(rough_fit.cost):
            rough_fits.append(rough_fit)
    rough_fits.sort(key=lambda fit: fit.cost)
    # All unknowns, from the best points.
    residual = residual_of(tuple(unknowns.free))
    starts = [fit.x for fit in rough_fits[:_FINISHED_STARTS]] or [x]
    minima = [solve_trf(residual, unknowns, record, start, loss) for start in starts]
    return min(minima, key=lambda solution: solution.cost)


def solve_or_try_others(
    residual_of: Callable[[tuple[int, ...]], Residual],
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
) -> Solution:
    """Return the minimum from one start; where that does not converge, the best from other viscosities.

    These are 0.1, 1 and 10 times as large. `residual_of` gives the residual whose free unknowns are at some places.
    """
    residual = residual_of(tuple(unknowns.free))
    solution = solve_trf(residual, unknowns, record, x, loss)
    viscosities = [i for i in unknowns.free if unknowns.items[i].unit == "Pa*s" and unknowns.items[i].value is None]
    if solution.converged or not viscosities:
        return solution
    # A rough fit of a coarser record from each combination of viscosities.
    coarse = _coarse(record)
    best_rough_fit = solution
    lowest_cost = np.inf
    for factors in product(_VISCOSITY_FACTORS, repeat=len(viscosities)):
        start = x.copy()
        start[viscosities] *= factors
        rough_fit = solve_trf(residual, unknowns, record=coarse, x=start, loss=loss, max_evaluations=_ROUGH_EVALUATIONS)
        if rough_fit.cost < lowest_cost:
            best_rough_fit, lowest_cost = rough_fit, rough_fit.cost
    # The best of them is followed to its minimum on the whole record.
    other = solve_trf(residual, unknowns, record, best_rough_fit.x, loss)
    return other if other.cost < solution.cost or not np.isfinite(solution.cost) else solution


def solve_from_each(
    residual: Residual, unknowns: Unknowns, record: FitRecord, starts: Sequence[Floats], loss: LossFunction
) -> list[Solution]:
    """Return the minima near some starts, the least first; raises NotFitted without any."""
    minima = [solve_lm(residual, unknowns, record, x, loss, gain=_START_GAIN) for x in starts]
    finite_minima = [minimum for minimum in minima if np.isfinite(minimum.cost)]
    if not finite_minima:
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    return sorted(finite_minima, key=lambda minimum: minimum.cost)


def rivals(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    best: Solution,
    minima: Sequence[Solution],
    loss: LossFunction,
) -> Iterator[Flag]:
    """Yield a note on values that are others at another minimum which describes a record as well.

    As well is a cost C (half of the sum of squares of n samples, p unknowns) that is higher by at most
    (3^2 s^2 + sum l_i^2)/2, s^2 = 2 C/(n - p) and l the standard uncertainty of the force by the model's law [N], half
    of the error that the model states. `minima` are those near other starts, on a thinned record.
    """
    freedom = max(len(record) - len(residual.free), 1)
    law_error = _LAW_STD_SHARE * residual.model.law_error * record.weight * record.force
    max_rise = 0.5 * (_PLAUSIBLE_SIGMAS**2 * 2.0 * best.cost / freedom + float(law_error @ law_error))
    # The farthest of such minima, by parameter.
    distances: dict[str, float] = {}
    for start in minima:
        minimum = solve_lm(residual, unknowns, record, start.x, loss)
        if minimum.cost - best.cost > max_rise:
            continue
        for name, distance in _distinct_values(residual, minimum, best):
            distances[name] = max(distance, distances.get(name, 0.0))
    if distances:
        units = {parameter.name: parameter.unit for parameter in residual.model.parameters}
        moved = ", ".join(f"{name} by {size:.3g} {units[name]}" for name, size in distances.items())
        text = f"another minimum describes the record as well, and moves {moved}"
        yield Flag("undetermined", text, effects=distances)


def _distinct_values(residual: Residual, minimum: Solution, best: Solution) -> Iterator[tuple[str, float]]:
    """Yield name and distance [SI] of each free parameter of the model that is off the best by more than a quarter."""
    parameters = residual.model.parameters
    for place in residual.free:
        if place < len(parameters):  # the others are not of the model
            distance = abs(float(minimum.x[place] - best.x[place]))
            if distance > _DISTINCT_SHARE * abs(best.x[place]):
                yield parameters[place].name, distance


def _duration(record: FitRecord) -> float:
    """Return the duration of a record [s]."""
    return float(record.time[-1] - record.time[0])


def _sample_interval(record: FitRecord) -> float:
    """Return the median interval of the samples [s] of a record with a history."""
    return float(np.median(record.columns[1:, len(PARTS)]))


def _time_grid(unknowns: Unknowns, place: int, record: FitRecord) -> Sequence[float]:
    """Return the relaxation times [s] that are tried of the unknown at a place; its value alone where it has one."""
    item = unknowns.items[place]
    if item.value is not None:
        return (item.value,)
    low = max(_SHORTEST_TIME * _sample_interval(record), item.lower)
    high = max(min(_LONGEST_TIME * _duration(record), item.upper), low)
    return tuple(np.geomspace(low, high, _GRID_TIMES).tolist())


def _coarse(record: FitRecord) -> FitRecord:
    """Return every n-th sample of a record, 1500 at most, with a history of the samples that are left."""
    step = -(-len(record) // _COARSE_SAMPLES)
    if step == 1:
        return record
    smooth = record.columns[::step, len(PARTS) + 1]
    coarse = make_record([part[::step] for part in record.parts], smooth=(smooth, 1))
    return replace(coarse, transition=record.transition)
