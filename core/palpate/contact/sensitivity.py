"""How the contact force answers to its parameters and to depth and rate: derivatives of the model itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from palpate.contact.interfaces import ContactModel, contact_force
from palpate.errors import ConfigurationError
from palpate.vectors import Floats

_TOGETHER = 1024  # samples


def force_slopes(
    model: ContactModel, depth: Floats, rate: Floats, theta: Sequence[float]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Force (n,) [N], its derivatives by the parameters (n, k), by depth (n,) [N/m] and by rate (n,) [N s/m].

    The derivatives are those of CasADi's expression for the model, exact to rounding. Raises ConfigurationError for a
    model with memory, whose force depends on more than these.
    """
    if model.memory:
        raise ConfigurationError(f"{type(model).__name__} remembers: its slopes are not those of depth and rate alone")
    hashable: Any = model
    try:
        maps = {n: _slopes_of_many(hashable, len(theta), n) for n in _lengths(len(depth))}
    except TypeError:  # a model that holds what cannot be hashed
        maps = {n: _slopes_of_many.__wrapped__(model, len(theta), n) for n in _lengths(len(depth))}
    given = [np.ascontiguousarray(column, np.float64) for column in (depth, rate)]
    parameters = np.array(theta, np.float64)
    f, table = np.empty(len(depth)), np.empty((len(depth), len(theta) + 2))
    for begin in range(0, len(depth), _TOGETHER):
        rows = slice(begin, begin + _TOGETHER)
        buffer, evaluate = maps[len(depth[rows])].buffer()
        for i, column in enumerate((given[0][rows], given[1][rows], parameters)):
            buffer.set_arg(i, column.data)
        buffer.set_res(0, f[rows].data)
        buffer.set_res(1, table[rows].data)  # the map puts the (1, k + 2) Jacobians side by side
        evaluate()
    return f, table[:, : len(theta)], table[:, -2], table[:, -1]


@lru_cache(32)
def _slopes_of_many(model: ContactModel, parameters: int, count: int) -> Any:
    """The force of a model and its derivatives for so many samples at once, as a function of CasADi."""
    import casadi

    d, v, p = casadi.SX.sym("d"), casadi.SX.sym("v"), casadi.SX.sym("p", parameters)
    force = contact_force(model, d, v, casadi.vertsplit(p))
    slopes = casadi.densify(casadi.jacobian(force, casadi.vertcat(p, d, v)))
    return casadi.Function("slopes", [d, v, p], [casadi.densify(force), slopes]).map("slopes", "serial", count, [2], [])


def _lengths(count: int) -> set[int]:
    """How long the blocks of so many samples are: a map over all of them would take longer to build than to run."""
    return {min(_TOGETHER, count), count % _TOGETHER} - {0}
