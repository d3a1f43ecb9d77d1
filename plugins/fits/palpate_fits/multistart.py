"""Several starts, for models whose cost has more than one minimum: those with a time of relaxation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from palpate import Floats

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord, make_record
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution, solve_trf
from palpate_fits.unknowns import EXTRAS, Unknowns

_TIMES = 6  # of each relaxation time, evenly in its logarithm
_SAMPLES = 1500  # of the record that is searched on
_SHORTEST, _LONGEST = 2.0, 0.5  # relaxation times tried: sample intervals, shares of the record
_BEYOND = 10.0  # lengths of the record
_ROUGH = 15  # evaluations of each start
_VISCOUS = (0.1, 1.0, 10.0)
_FINISHED = 2  # starts that are followed to the end


def times_of(unknowns: Unknowns) -> list[int]:
    """Places of the free relaxation times of a model."""
    return [i for i in unknowns.free if unknowns.items[i].unit == "s" and unknowns.items[i].name not in EXTRAS]


def with_times_that_show(unknowns: Unknowns, record: FitRecord) -> Unknowns:
    """The unknowns with relaxation times between the interval of the samples and ten times the length of the record.

    Beyond either end the record is that of a model without the relaxation, which a flag says: at a bound.
    """
    low = float(np.median(record.columns[1:, 6]))
    high = _BEYOND * _span(record)
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
    """The best minimum from a grid of relaxation times, the other unknowns fitted for each of them first.

    The grid is searched on a coarser record; the best few are followed to their minimum on the whole one.
    """
    times = times_of(unknowns)
    others = tuple(place for place in unknowns.free if place not in times)
    coarse = _coarse(record)
    found: list[tuple[float, int, Floats]] = []
    for values in product(*(_grid(unknowns, place, coarse) for place in times)):
        start = x.copy()
        start[times] = values
        one = solve_trf(residual_of(others), unknowns, coarse, start, loss, _ROUGH)
        if np.isfinite(one.cost):
            found.append((one.cost, len(found), one.x))
    found.sort(key=lambda item: item[:2])
    residual = residual_of(tuple(unknowns.free))
    ended = [solve_trf(residual, unknowns, record, start, loss) for _, _, start in found[:_FINISHED]]
    return min(ended, key=lambda solution: solution.cost) if ended else solve_trf(residual, unknowns, record, x, loss)


def solve_or_try_others(
    residual_of: Callable[[tuple[int, ...]], Residual],
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
) -> Solution:
    """The minimum from one start; where that leads to none, the best from viscosities ten times smaller and larger."""
    residual = residual_of(tuple(unknowns.free))
    found = solve_trf(residual, unknowns, record, x, loss)
    places = [i for i in unknowns.free if unknowns.items[i].unit == "Pa*s" and unknowns.items[i].value is None]
    if found.converged or not places:
        return found
    coarse, tried = _coarse(record), list[Solution]()
    for factors in product(_VISCOUS, repeat=len(places)):
        start = x.copy()
        start[places] *= factors
        tried.append(solve_trf(residual, unknowns, coarse, start, loss, _ROUGH))
    best = min((one for one in tried if np.isfinite(one.cost)), key=lambda one: one.cost, default=found)
    other = solve_trf(residual, unknowns, record, best.x, loss)
    return other if other.cost < found.cost or not np.isfinite(found.cost) else found


def _span(record: FitRecord) -> float:
    return float(record.columns[-1, 4] - record.columns[0, 4])


def _grid(unknowns: Unknowns, place: int, record: FitRecord) -> Sequence[float]:
    item = unknowns.items[place]
    low = max(_SHORTEST * float(np.median(record.columns[1:, 6])), item.lower)
    high = max(min(_LONGEST * _span(record), item.upper), low)
    if item.value is not None:
        return (item.value,)
    return tuple(np.geomspace(low, high, _TIMES).tolist())


def _coarse(record: FitRecord) -> FitRecord:
    """Every so many samples of a record, with intervals and samples before as they then are."""
    step = -(-len(record) // _SAMPLES)
    if step == 1:
        return record
    smooth = record.columns[::step, 7]
    coarse = make_record([part[::step] for part in record.parts], smooth=(smooth, 1))
    return replace(coarse, transition=record.transition)
