"""First guesses of a model of several moduli, whose force is in proportion to all of them together only."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from palpate import ContactModel, Floats
from palpate_kit.numerics.variable_projection import linear_part

from palpate_fits.first_guess import Guess, few_samples, linear_columns, unknown_grid
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import reading
from palpate_fits.unknowns import Unknowns

_CONTRASTS = (1.0, 0.1, 0.3, 3.0, 10.0)  # of moduli (choice); where they are alike the material is one half-space
_MIN_MODULUS_SCALE = 1e-3  # [1] of the moduli of a start, which are of the order 1 Pa (choice)


def guess_by_contrast(
    model: ContactModel, unknowns: Unknowns, record: FitRecord, linear: Sequence[int], moduli: Sequence[int]
) -> list[Floats]:
    """Return starts (P,): one for each contrast of the first modulus to the others, at each point of the other grids.

    `linear` and `moduli` are places among the unknowns. The force is proportional to all moduli together, so their
    scale is solved for with the other `linear` unknowns; the surface is the best one of its grid. A contrast of 1 is a
    half-space.
    """
    thinned = few_samples(record)
    # An unknown without a grid starts at 1 [SI].
    grids = [unknown_grid(item, place, linear, thinned, 1.0) for place, item in enumerate(unknowns.items)]
    surface = unknowns.index("surface")
    heights, grids[surface] = grids[surface], (0.0,)
    grids[moduli[0]] = _CONTRASTS
    best_guesses: list[Guess] = []
    for start in product(*grids):
        starts = [np.array((*start[:surface], height, *start[surface + 1 :])) for height in heights]
        guesses = [solve_scaled(model, unknowns, record=thinned, x=x, linear=linear, moduli=moduli) for x in starts]
        best_guesses.append(min(guesses, key=lambda guess: guess.cost))
    return [guess.x for guess in best_guesses if np.isfinite(guess.cost)]


def moduli_of(model: ContactModel, unknowns: Unknowns, linear: Sequence[int]) -> tuple[int, ...]:
    """Return the places of free moduli in which the residual is not linear; () if one alone, or with memory."""
    free = [i for i in unknowns.free if unknowns.items[i].unit == "Pa" and unknowns.items[i].value is None]
    places = tuple(i for i in free if i not in linear)
    return places if len(places) > 1 and not model.memory else ()


def solve_scaled(
    model: ContactModel,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    linear: Sequence[int],
    moduli: Sequence[int],
) -> Guess:
    """Return the best scale of some moduli and values of the linear unknowns with the others given, and their cost.

    `linear` and `moduli` are places among the parameters x (P,), of which the others hold the values that are given.
    The force is proportional to all moduli together. So with the errors e_1 and e_2 at these moduli and at twice these,
    e_2 - e_1 is the force of the moduli, and the error without it is 2 e_1 - e_2.
    """
    base, rows = x.copy(), list(record.parts)
    base[list(linear)] = 0.0
    doubled = base.copy()
    doubled[list(moduli)] *= 2.0
    # The errors at the moduli and at twice these, and the columns of the other linear unknowns.
    with np.errstate(all="ignore"):
        error, error_doubled = (
            record.weight * (reading(model, parameters.tolist(), rows, record.transition) - record.force)
            for parameters in (base, doubled)
        )
        columns = [error_doubled - error, *linear_columns(model, record, base, linear, error, memory=())]
    # The scale of the moduli and the linear unknowns of |columns y + 2 e_1 - e_2|^2.
    low, high = unknowns.bounds(linear)
    bounds = np.append(_MIN_MODULUS_SCALE, low), np.append(np.inf, high)
    solution = linear_part(np.column_stack(columns), error_doubled - 2.0 * error, *bounds)
    base[list(moduli)] *= solution.unknowns[0]
    base[list(linear)] = solution.unknowns[1:]
    return Guess(base, solution.squares)
