"""First guess: the surface on a grid, everything that enters linearly solved for, on a few hundred samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats
from palpate_kit.numerics.least_squares import bounded_quadratic
from palpate_kit.numerics.refusal import NotFitted
from palpate_kit.numerics.variable_projection import linear_part

from palpate_fits.adhesive_guess import adhesive_guess
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual, reading
from palpate_fits.unknowns import EXTRAS, FitUnknown, Unknowns

_SAMPLES = 500
_LINEAR_EXTRAS = ("bias", "slope", "tip_mass")
_INSIDE = np.linspace(0.0, 1.0, 41)[1:]  # heights within the record, as shares of its range from the bottom
_ABOVE = np.geomspace(0.01, 12.0, 36)  # heights above it
_SINGULAR, _ROUNDING = 1e-7, 1e-7  # of scaled squares; their sums are exact to some 1e-13 over the first of both
_CONTRASTS = (1.0, 0.1, 0.3, 3.0, 10.0)  # of moduli; alike they are one half-space, which others contain
_THICKNESSES = (3e-4, 1e-3, 3e-3, 1e-2)  # [m]
_LEAST = 1e-3  # [Pa], scale of moduli
_GRIDS = {"1": (1.0, 1.5, 2.0, 3.0), "s": (0.03, 0.1, 0.3, 1.0)}  # of what is not linear, by unit
_DECLARED = ("Pa", "m^2/s")  # where what is not linear begins as the model says, unless its material flows


@dataclass(frozen=True)
class Guess:
    """A start for the solvers."""

    x: Floats  # (P,)
    cost: float


def linear_places(model: ContactModel, unknowns: Unknowns) -> list[int]:
    """Places of the free unknowns in which, taken together, the residual is linear; found from the expression."""
    import casadi as ca

    depth, rate = ca.SX.sym("d"), ca.SX.sym("v")
    theta: Any = ca.SX.sym("t", len(model.parameters))
    memory = ca.SX.sym("m", len(model.memory))
    force = model.force(depth, rate, ca.vertsplit(theta), ca.vertsplit(memory) if model.memory else ())
    found: list[int] = []
    for place in range(len(model.parameters)):
        together = ca.vertcat(*(theta[i] for i in [*found, place]))
        if ca.is_linear(force, together):
            found.append(place)
    if model.memory:
        rates = ca.vertcat(*model.memory_rate(depth, rate, ca.vertsplit(theta), ca.vertsplit(memory)))
        found = [place for place in found if not ca.depends_on(rates, theta[place])]
    found += [unknowns.index(name) for name in _LINEAR_EXTRAS]
    return [place for place in found if unknowns.items[place].free]


def first_guess(
    model: ContactModel,
    unknowns: Unknowns,
    record: FitRecord,
    linear: Sequence[int],
    residual: Callable[[tuple[int, ...]], Residual],
) -> Floats:
    """Values (P,) of all parameters to start from; raises NotFitted where nothing fits.

    `linear` are places of `linear_places`; `residual` gives the residual that is free in some places. What the linear
    unknowns could leave without their bounds is cheap to compute and never more than what they leave within them: only
    starts that may be the best are solved.
    """
    thin = record.thinned(_SAMPLES)
    if not thin.used.all():
        thin = thin.selected(thin.used)
    own = unknowns.items[: len(model.parameters)]
    if model.adhesive and all(item.free for item in own) and not set(range(len(own))) <= set(linear):
        return adhesive_guess(model, unknowns, record)
    solid = bool(model.memory) and all(parameter.unit != "Pa*s" for parameter in model.parameters)
    told = (one for one in model.parameters if solid and one.unit in _DECLARED)
    starts_of = {one.name: one.start for one in told if one.start is not None}
    grids = [
        _grid(item, place, linear, thin, starts_of.get(item.name, 1.0)) for place, item in enumerate(unknowns.items)
    ]
    grids.append(grids.pop(unknowns.index("surface")))
    names = [i for i in range(len(unknowns.items)) if i != unknowns.index("surface")]
    starts = np.zeros((math.prod(len(grid) for grid in grids), len(unknowns.items)))
    each = len(starts)
    for place, grid in zip([*names, unknowns.index("surface")], grids, strict=True):
        each //= len(grid)
        starts[:, place] = np.tile(np.repeat(grid, each), len(starts) // (each * len(grid))) if len(grid) > 1 else grid
    squares, least, clear = np.zeros(0), np.zeros(len(starts)), np.zeros(len(starts), bool)
    if linear and not model.memory:
        starts[:, list(linear)] = 0.0
        squares = residual(tuple(linear)).normal(thin, starts)
        least, clear = _least(squares)
    found: list[tuple[float, int, Floats]] = []
    for place in np.argsort(least, kind="stable").tolist():
        if found and least[place] > min(found)[0]:
            break
        if clear[place]:
            guess = _solved(squares[place], unknowns, starts[place], linear)
        else:
            guess = solve_linear(model, unknowns, thin, starts[place], linear)
        if np.isfinite(guess.cost):
            found.append((guess.cost, place, guess.x))
    if not found:
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    return min(found, key=lambda one: one[:2])[2]


def _least(squares: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Costs (m,) that no values of the linear unknowns can fall below, by [r, J]^T [r, J] (m, 1 + p, 1 + p); and which
    of them determine these unknowns, the others being 0.

    What is left of r when every column of J is taken out of it, one after the other (Gauss).
    """
    scale = np.sqrt(np.maximum(squares.diagonal(axis1=1, axis2=2), 1e-300))
    known = np.asarray(np.isfinite(scale).all(axis=1))  # and with its squares all other products
    with np.errstate(all="ignore"):  # where nothing is known
        left = np.moveaxis(squares / (scale[:, :, None] * scale[:, None, :]), 0, -1)
        for k in range(len(left) - 1, 0, -1):
            pivot = left[k, k]
            known &= pivot > _SINGULAR
            left = left[:k, :k] - left[:k, k, None] * (left[k, :k] / pivot)
    return np.where(known, np.maximum(left[0, 0] - _ROUNDING, 0.0) * scale[:, 0] ** 2, 0.0), known


def _solved(square: Floats, unknowns: Unknowns, base: Floats, linear: Sequence[int]) -> Guess:
    """Return the best values of the linear unknowns, within bounds, by [r, J]^T [r, J] (1 + p, 1 + p) where they are
    0."""
    scale = np.sqrt(np.maximum(square.diagonal(), 1e-300))
    unit = square / (scale[:, None] * scale)
    low, high = (edge * scale[1:] / scale[0] for edge in unknowns.bounds(linear))
    middle = np.minimum(np.maximum(0.0, low), high)
    found = middle + bounded_quadratic(unit[1:, 1:], unit[1:, 0] + unit[1:, 1:] @ middle, low - middle, high - middle)
    x = base.copy()
    x[list(linear)] = found * scale[0] / scale[1:]
    left = unit[0, 0] + 2.0 * float(unit[0, 1:] @ found) + float(found @ unit[1:, 1:] @ found)
    return Guess(x, max(left, 0.0) * float(scale[0]) ** 2)


def _grid(item: FitUnknown, place: int, linear: Sequence[int], record: FitRecord, start: float) -> tuple[float, ...]:
    if item.value is not None and not (item.free and place in linear):
        return (item.value,)
    if not item.free or place in linear:
        return (0.0,)
    if item.name == "surface":
        low, reach = float(record.height.min()), float(np.ptp(record.height))
        heights = np.concatenate([low + reach * _INSIDE, low + reach * (1 + _ABOVE)])
        inside = heights[(heights >= item.lower) & (heights <= item.upper)]
        return tuple(inside) or (item.inside(float(record.height.max())),)
    if item.unit == "m":
        return tuple(h for h in _THICKNESSES if item.lower <= h <= item.upper) or (item.inside(start),)
    if item.name == "delay":
        return (item.inside(0.0),)
    if np.isfinite(item.upper) and item.upper > item.lower and item.name not in EXTRAS:
        return tuple((item.lower + (item.upper - item.lower) * np.array([0.2, 0.5, 0.8])).tolist())
    allowed = tuple(value for value in _GRIDS.get(item.unit, (start,)) if item.lower <= value <= item.upper)
    return allowed or (item.inside(start),)


def solve_linear(model: ContactModel, unknowns: Unknowns, record: FitRecord, x: Floats, linear: Sequence[int]) -> Guess:
    """Return the best values of the linear unknowns with the others given, within bounds, and their cost."""
    rows, memory = list(record.parts), (0.0,) * len(model.memory)
    base = x.copy()
    base[list(linear)] = 0.0
    with np.errstate(all="ignore"):
        error = record.weight * (reading(model, base.tolist(), rows, record.transition, memory) - record.force)
        columns = list(_columns(model, record, base, linear, error, memory))
    if not columns:
        return Guess(base, float(error @ error) if np.isfinite(error).all() else np.inf)
    found = linear_part(np.column_stack(columns), -error, *unknowns.bounds(linear))
    base[list(linear)] = found.unknowns
    return Guess(base, found.squares)


def guess_by_contrast(
    model: ContactModel, unknowns: Unknowns, record: FitRecord, linear: Sequence[int], moduli: Sequence[int]
) -> list[Floats]:
    """Values (P,) to start from, for each contrast of the first of some moduli to the others and what else has a grid.

    The force is proportional to all moduli together, so their scale is found with the other `linear` unknowns; the
    surface is the best one. Where the moduli are alike the material is a half-space.
    """
    thin = record.thinned(_SAMPLES)
    thin = thin if thin.used.all() else thin.selected(thin.used)
    grids = [_grid(item, place, linear, thin, 1.0) for place, item in enumerate(unknowns.items)]
    surface, found = unknowns.index("surface"), list[Guess]()
    heights, grids[surface] = grids[surface], (0.0,)
    grids[moduli[0]] = _CONTRASTS
    for start in product(*grids):
        every = [(*start[:surface], height, *start[surface + 1 :]) for height in heights]
        guesses = [solve_scaled(model, unknowns, thin, np.array(x), linear, moduli) for x in every]
        found.append(min(guesses, key=lambda guess: guess.cost))
    return [guess.x for guess in found if np.isfinite(guess.cost)]


def moduli_of(model: ContactModel, unknowns: Unknowns, linear: Sequence[int]) -> tuple[int, ...]:
    """Places of several moduli that a model without memory is not linear in, by itself each; else nothing."""
    free = [i for i in unknowns.free if unknowns.items[i].unit == "Pa" and unknowns.items[i].value is None]
    found = tuple(i for i in free if i not in linear)
    return found if len(found) > 1 and not model.memory else ()


def solve_scaled(
    model: ContactModel,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    linear: Sequence[int],
    moduli: Sequence[int],
) -> Guess:
    """Return the best scale of some moduli and values of the linear unknowns with the others given, and their cost."""
    base, rows = x.copy(), list(record.parts)
    base[list(linear)] = 0.0
    twice = base.copy()
    twice[list(moduli)] *= 2.0
    with np.errstate(all="ignore"):
        once, more = (
            record.weight * (reading(model, at.tolist(), rows, record.transition) - record.force)
            for at in (base, twice)
        )
        columns = [more - once, *_columns(model, record, base, linear, once, ())]
    low, high = unknowns.bounds(linear)
    bounds = np.append(_LEAST, low), np.append(np.inf, high)
    found = linear_part(np.column_stack(columns), more - 2.0 * once, *bounds)
    base[list(moduli)] *= found.unknowns[0]
    base[list(linear)] = found.unknowns[1:]
    return Guess(base, found.squares)


def _columns(
    model: ContactModel, record: FitRecord, base: Floats, linear: Sequence[int], error: Floats, memory: Sequence[float]
) -> Iterator[Floats]:
    rows = list(record.parts)
    for place in linear:
        unit = base.copy()
        unit[place] = 1.0
        one = reading(model, unit.tolist(), rows, record.transition, memory)
        yield record.weight * (one - record.force) - error
