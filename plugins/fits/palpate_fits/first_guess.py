"""First guess: the surface on a grid, everything that enters linearly solved for, on a few hundred samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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

_LINEAR_EXTRAS = ("bias", "slope", "tip_mass")
# Choices: the grids on which a start is looked for.
_SAMPLES = 500  # of the thinned record
_INSIDE = np.linspace(0.0, 1.0, 41)[1:]  # heights of the surface in the record, as shares of its range from the bottom
_ABOVE = np.geomspace(0.01, 12.0, 36)  # heights of the surface above the record, in its range
_THICKNESSES = (3e-4, 1e-3, 3e-3, 1e-2)  # [m]
_GRIDS = {"1": (1.0, 1.5, 2.0, 3.0), "s": (0.03, 0.1, 0.3, 1.0)}  # of numbers and times without two bounds, by unit
_BOUNDED_SHARES = (0.2, 0.5, 0.8)  # of the range of a parameter with two bounds
_DECLARED_UNITS = ("Pa", "m^2/s")  # of parameters that start as the model declares, unless its material flows
# Numerics.
_SINGULAR_PIVOT = 1e-7  # of a squared column of length 1: what the other columns cannot follow of it
_ROUNDING = 1e-7  # of the scaled squares, whose sums are exact to some 1e-13 over the pivot
_SMALLEST_SQUARE = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class Guess:
    """A start for the solvers."""

    x: Floats  # (P,)
    cost: float


def linear_places(model: ContactModel, unknowns: Unknowns) -> list[int]:
    """Return the places of free unknowns in which the residual is linear, in all of them together.

    They follow from the symbolic expression of the force. In a parameter on which the memory's rate equation depends
    the residual is not linear.
    """
    import casadi as ca

    depth, rate = ca.SX.sym("d"), ca.SX.sym("v")
    theta: Any = ca.SX.sym("t", len(model.parameters))
    memory = ca.SX.sym("m", len(model.memory))
    force = model.force(depth, rate, ca.vertsplit(theta), ca.vertsplit(memory) if model.memory else ())
    # A parameter joins those before it if the force is linear in all of them together.
    places: list[int] = []
    for place in range(len(model.parameters)):
        together = ca.vertcat(*(theta[i] for i in [*places, place]))
        if ca.is_linear(force, together):
            places.append(place)
    if model.memory:
        rates = ca.vertcat(*model.memory_rate(depth, rate, ca.vertsplit(theta), ca.vertsplit(memory)))
        places = [place for place in places if not ca.depends_on(rates, theta[place])]
    places += [unknowns.index(name) for name in _LINEAR_EXTRAS]
    return [place for place in places if unknowns.items[place].free]


def first_guess(
    model: ContactModel,
    unknowns: Unknowns,
    record: FitRecord,
    linear: Sequence[int],
    residual: Callable[[tuple[int, ...]], Residual],
) -> Floats:
    """Return values (P,) of all parameters to start from; raises NotFitted where nothing fits.

    Of each parameter in which the residual is not linear a grid is tried. The `linear` ones, places of `linear_places`,
    are solved for at each point; `residual` gives the residual that is free in some places. The least cost without
    bounds of the linear ones is cheap to compute, and never above that within the bounds: so the points are solved in
    its order, until it exceeds the best cost so far.
    """
    thinned = few_samples(record)
    own_items = unknowns.items[: len(model.parameters)]
    is_linear = set(range(len(own_items))) <= set(linear)
    if model.adhesive and all(item.free for item in own_items) and not is_linear:
        return adhesive_guess(model, unknowns, record)
    # Points of the grid, [r, J]^T [r, J] at each, and the lowest cost that each can have; 0 where that is not known.
    starts = _grid_starts(model, unknowns, thinned, linear)
    squares, lowest, is_definite = np.zeros(0), np.zeros(len(starts)), np.zeros(len(starts), bool)
    if linear and not model.memory:
        starts[:, list(linear)] = 0.0
        squares = residual(tuple(linear)).normal(thinned, starts)
        lowest, is_definite = _lowest_costs(squares)
    # The points in the order of their lowest cost, until none can be better than the best so far.
    best: Guess | None = None
    best_point = 0
    for point in np.argsort(lowest, kind="stable").tolist():
        if best is not None and lowest[point] > best.cost:
            break
        if is_definite[point]:
            guess = _solve_normal(squares[point], unknowns, starts[point], linear)
        else:
            guess = solve_linear(model, unknowns, thinned, starts[point], linear)
        # Of equal costs the first point of the grid is taken, in whatever order they come.
        if np.isfinite(guess.cost) and (best is None or (guess.cost, point) < (best.cost, best_point)):
            best, best_point = guess, point
    if best is None:
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    return best.x


def _grid_starts(model: ContactModel, unknowns: Unknowns, record: FitRecord, linear: Sequence[int]) -> Floats:
    """Return all combinations (m, P) of the values that are tried of each unknown, the surface varying fastest."""
    declared_starts = _declared_starts(model)
    grids = []
    for place, item in enumerate(unknowns.items):
        start = declared_starts.get(item.name, 1.0)  # 1 [SI], where the model declares none
        grids.append(unknown_grid(item, place, linear, record, start))
    return _grid_points(grids, unknowns.index("surface"))


def few_samples(record: FitRecord) -> FitRecord:
    """Return some hundred samples of a record, all of which count."""
    thinned = record.thinned(_SAMPLES)
    return thinned if thinned.used.all() else thinned.selected(thinned.used)


def _declared_starts(model: ContactModel) -> dict[str, float]:
    """Return, by name, the start values of moduli and diffusivities of a solid with memory, as the model declares them.

    A model with a viscosity flows, and has none.
    """
    if not model.memory or any(parameter.unit == "Pa*s" for parameter in model.parameters):
        return {}
    return {p.name: p.start for p in model.parameters if p.unit in _DECLARED_UNITS and p.start is not None}


def _grid_points(grids: Sequence[tuple[float, ...]], fastest: int) -> Floats:
    """Return all combinations (m, P) of the grids' values, the one at the place `fastest` varying fastest."""
    points = np.zeros((math.prod(len(grid) for grid in grids), len(grids)))
    repeats = len(points)  # of each value, until the next one
    for place in [*(i for i in range(len(grids)) if i != fastest), fastest]:
        grid = grids[place]
        repeats //= len(grid)
        points[:, place] = np.tile(np.repeat(grid, repeats), len(points) // (repeats * len(grid)))
    return points


def _lowest_costs(squares: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the least costs (m,) without bounds, by [r, J]^T [r, J] (m, 1 + p, 1 + p), and where these are definite.

    Gauss' elimination of every column of J leaves |r|^2 less all that J can take of it; 0, the lowest bound, where the
    columns do not determine the unknowns.
    """
    scale = np.sqrt(np.maximum(squares.diagonal(axis1=1, axis2=2), _SMALLEST_SQUARE))
    is_definite = np.asarray(np.isfinite(scale).all(axis=1))  # and so are all other products
    with np.errstate(all="ignore"):  # where they are not finite
        remainder = np.moveaxis(squares / (scale[:, :, None] * scale[:, None, :]), 0, -1)
        for k in range(len(remainder) - 1, 0, -1):
            pivot = remainder[k, k]
            is_definite &= pivot > _SINGULAR_PIVOT
            remainder = remainder[:k, :k] - remainder[:k, k, None] * (remainder[k, :k] / pivot)
    costs = np.maximum(remainder[0, 0] - _ROUNDING, 0.0) * scale[:, 0] ** 2
    return np.where(is_definite, costs, 0.0), is_definite


def _solve_normal(square: Floats, unknowns: Unknowns, base: Floats, linear: Sequence[int]) -> Guess:
    """Return the best values of the linear unknowns within bounds, by [r, J]^T [r, J] (1 + p, 1 + p) where they are 0.

    With columns of length 1 the cost of y is r^T r + 2 r^T J y + y^T J^T J y.
    """
    scale = np.sqrt(np.maximum(square.diagonal(), _SMALLEST_SQUARE))
    unit = square / (scale[:, None] * scale)
    low, high = (bound * scale[1:] / scale[0] for bound in unknowns.bounds(linear))
    # The quadratic is solved from the point nearest to 0 within the bounds.
    centre = np.minimum(np.maximum(0.0, low), high)
    gradient = unit[1:, 0] + unit[1:, 1:] @ centre
    y = centre + bounded_quadratic(unit[1:, 1:], gradient, low - centre, high - centre)
    cost = unit[0, 0] + 2.0 * float(unit[0, 1:] @ y) + float(y @ unit[1:, 1:] @ y)
    x = base.copy()
    x[list(linear)] = y * scale[0] / scale[1:]
    return Guess(x, max(cost, 0.0) * float(scale[0]) ** 2)


def unknown_grid(
    item: FitUnknown, place: int, linear: Sequence[int], record: FitRecord, start: float
) -> tuple[float, ...]:
    """Return the values that are tried of the unknown at a place among all.

    Its value alone where it has one, and 0 where it is solved for. Of the surface heights within the record and above,
    of a layer usual thicknesses; of a delay 0. Of other parameters shares of the way between two finite bounds, else
    the values of its unit that its bounds admit. Where none is left, `start` alone, within the bounds.
    """
    is_solved_for = item.free and place in linear
    if item.value is not None and not is_solved_for:
        return (item.value,)
    if not item.free or is_solved_for:
        return (0.0,)
    if item.name == "surface":
        low, reach = float(record.height.min()), float(np.ptp(record.height))
        heights = np.concatenate([low + reach * _INSIDE, low + reach * (1 + _ABOVE)])
        allowed_heights = heights[(heights >= item.lower) & (heights <= item.upper)]
        return tuple(allowed_heights) or (item.inside(float(record.height.max())),)
    if item.unit == "m":
        return _allowed(_THICKNESSES, item, start)
    if item.name == "delay":
        return (item.inside(0.0),)
    if np.isfinite(item.upper) and item.upper > item.lower and item.name not in EXTRAS:
        return tuple((item.lower + (item.upper - item.lower) * np.array(_BOUNDED_SHARES)).tolist())
    return _allowed(_GRIDS.get(item.unit, (start,)), item, start)


def _allowed(values: Sequence[float], item: FitUnknown, start: float) -> tuple[float, ...]:
    """Return the values within the bounds of an unknown; without any `start`, moved to the nearer bound."""
    allowed_values = tuple(value for value in values if item.lower <= value <= item.upper)
    return allowed_values or (item.inside(start),)


def solve_linear(model: ContactModel, unknowns: Unknowns, record: FitRecord, x: Floats, linear: Sequence[int]) -> Guess:
    """Return the best values of the linear unknowns with the others given, within bounds, and their cost."""
    rows, memory = list(record.parts), (0.0,) * len(model.memory)
    base = x.copy()
    base[list(linear)] = 0.0
    with np.errstate(all="ignore"):
        error = record.weight * (reading(model, base.tolist(), rows, record.transition, memory) - record.force)
        columns = list(linear_columns(model, record, base, linear, error, memory))
    if not columns:
        return Guess(base, float(error @ error) if np.isfinite(error).all() else np.inf)
    solution = linear_part(np.column_stack(columns), -error, *unknowns.bounds(linear))
    base[list(linear)] = solution.unknowns
    return Guess(base, solution.squares)


def linear_columns(
    model: ContactModel, record: FitRecord, base: Floats, linear: Sequence[int], error: Floats, memory: Sequence[float]
) -> Iterator[Floats]:
    """Yield the derivative (n,) of the residual by each linear unknown, the difference of its values at 1 and at 0."""
    rows = list(record.parts)
    for place in linear:
        unit = base.copy()
        unit[place] = 1.0
        expected = reading(model, unit.tolist(), rows, record.transition, memory)
        yield record.weight * (expected - record.force) - error
