"""Arms of a model that may change places, in the order of their times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import ContactModel, Floats

from palpate_fits.solvers import Solution
from palpate_fits.unknowns import Unknowns


def in_order(model: ContactModel, unknowns: Unknowns, solution: Solution) -> Solution:
    """Return the same minimum with the model's interchangeable arms in the order of their times.

    Unchanged where a user's settings distinguish them.
    """
    places = list(range(len(solution.x)))
    order = places_in_order(model, solution.x)
    if order == places[: len(order)] or not _alike(model, unknowns):
        return solution
    places[: len(order)] = order
    moved = None if solution.moved is None else solution.moved[places]
    return replace(solution, x=solution.x[places], moved=moved)


def places_in_order(model: ContactModel, theta: Floats) -> list[int]:
    """Return, for each parameter of the ordered model, its place among these (k,): arms by rising last value."""
    arms = model.interchangeable
    places = list(range(len(model.parameters)))
    ordered_arms = sorted(arms, key=lambda places_of_arm: float(theta[places_of_arm[-1]]))
    for arm, ordered_arm in zip(arms, ordered_arms, strict=True):
        for place, ordered_place in zip(arm, ordered_arm, strict=True):
            places[place] = ordered_place
    return places


def _alike(model: ContactModel, unknowns: Unknowns) -> bool:
    """Return True if the settings do not distinguish the arms: all free, with the same bounds and no start."""
    for places in zip(*model.interchangeable, strict=True):
        items = [unknowns.items[place] for place in places]
        if not all(item.free and item.value is None for item in items):
            return False
        if np.ptp([item.lower for item in items]) or len({item.upper for item in items}) > 1:
            return False
    return True
