"""Several starts, for models whose cost has more than one minimum: those with a time of relaxation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from palpate import Flag, Floats
from palpate_kit.numerics.refusal import NotFitted

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord, make_record
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution, solve_lm, solve_trf
from palpate_fits.unknowns import EXTRAS, Unknowns

_TIMES = 6  # of each relaxation time, evenly in its logarithm
_SAMPLES = 1500  # of the record that is searched on
_SHORTEST, _LONGEST = 2.0, 0.5  # relaxation times tried: sample intervals, shares of the record
_BEYOND = 10.0  # lengths of the record
_ROUGH = 15  # evaluations of each start
_VISCOUS = (0.1, 1.0, 10.0)
_SIGMAS, _ANOTHER = 3.0, 0.25  # of a minimum that is as good; share of a value by which it is another
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
    """Return the best minimum from a grid of relaxation times, the other unknowns fitted for each of them first.

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
    """Return the minimum from one start; where that leads to none, the best from viscosities ten times smaller and
    larger."""
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


def solve_from_each(
    residual: Residual, unknowns: Unknowns, record: FitRecord, starts: Sequence[Floats], loss: LossFunction
) -> list[Solution]:
    """Return the minima near some starts, the least first; raises NotFitted without any."""
    found = [solve_lm(residual, unknowns, record, x, loss, gain=1e-9) for x in starts]
    found = sorted((one for one in found if np.isfinite(one.cost)), key=lambda one: one.cost)
    if not found:
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    return found


def rivals(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    best: Solution,
    minima: Sequence[Solution],
    loss: LossFunction,
) -> Iterator[Flag]:
    """Yield a note on values that are others at another minimum which describes a record as well.

    As well is what three standard deviations of the residual allow, and what the model's law may itself be off.
    """
    few, names = max(len(record) - len(residual.free), 1), [one.name for one in residual.model.parameters]
    law = 0.5 * residual.model.law_error * record.weight * record.force
    allowed = 0.5 * (_SIGMAS**2 * 2.0 * best.cost / few + float(law @ law))
    apart: dict[str, float] = {}
    for one in (solve_lm(residual, unknowns, record, other.x, loss) for other in minima):
        if one.cost - best.cost <= allowed:
            for place in residual.free[: len(names)]:
                far = abs(float(one.x[place] - best.x[place]))
                if place < len(names) and far > _ANOTHER * abs(best.x[place]):
                    apart[names[place]] = max(far, apart.get(names[place], 0.0))
    if apart:
        units = {one.name: one.unit for one in residual.model.parameters}
        moved = ", ".join(f"{name} by {size:.3g} {units[name]}" for name, size in apart.items())
        yield Flag("undetermined", f"another minimum describes the record as well, and moves {moved}", effects=apart)


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
    """Return every so many samples of a record, with intervals and samples before as they then are."""
    step = -(-len(record) // _SAMPLES)
    if step == 1:
        return record
    smooth = record.columns[::step, 7]
    coarse = make_record([part[::step] for part in record.parts], smooth=(smooth, 1))
    return replace(coarse, transition=record.transition)
