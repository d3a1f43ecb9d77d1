"""Arms of a model that may change places, in the order of their times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import ContactModel, Floats

from palpate_fits.solvers import Solution
from palpate_fits.unknowns import Unknowns


def in_order(model: ContactModel, unknowns: Unknowns, solution: Solution) -> Solution:
    """Return the same minimum with the model's interchangeable parameters in rising order, unless a user named one
    of them."""
    places = list(range(len(solution.x)))
    order = places_in_order(model, solution.x)
    if order == places[: len(order)] or not _alike(model, unknowns):
        return solution
    places[: len(order)] = order
    moved = None if solution.moved is None else solution.moved[places]
    return replace(solution, x=solution.x[places], moved=moved)


def places_in_order(model: ContactModel, theta: Floats) -> list[int]:
    """Where each parameter of the ordered model stands among these."""
    groups = model.interchangeable
    places = list(range(len(model.parameters)))
    for group, taken in zip(groups, sorted(groups, key=lambda group: float(theta[group[-1]])), strict=True):
        for to, of in zip(group, taken, strict=True):
            places[to] = of
    return places


def _alike(model: ContactModel, unknowns: Unknowns) -> bool:
    """Return True if nothing distinguishes the groups: all free, with the same bounds, and started nowhere in
    particular."""
    for places in zip(*model.interchangeable, strict=True):
        items = [unknowns.items[place] for place in places]
        if not all(item.free and item.value is None for item in items):
            return False
        if np.ptp([item.lower for item in items]) or len({item.upper for item in items}) > 1:
            return False
    return True
