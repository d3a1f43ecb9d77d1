"""Derivatives of the contact force by its parameters, depth and rate: those of the model itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from palpate.contact.interfaces import ContactModel, contact_force
from palpate.errors import ConfigurationError
from palpate.vectors import Floats

_BLOCK = 1024  # samples, a choice: a longer map takes longer to build than to run
_KEPT_FUNCTIONS = 32  # a choice: of the models of one run, each with two lengths


def force_slopes(
    model: ContactModel, depth: Floats, rate: Floats, theta: Sequence[float]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return force (n,) [N], its derivatives by the parameters (n, k), by depth (n,) [N/m] and by rate (n,) [N s/m].

    The derivatives are those of CasADi's expression for the model, exact to rounding. Raises ConfigurationError for a
    model with memory, whose force depends on more than these.
    """
    if model.memory:
        raise ConfigurationError(f"{type(model).__name__} remembers: its slopes are not those of depth and rate alone")
    # Functions for whole blocks and for the last one; kept, for models that can be hashed.
    hashable: Any = model
    try:
        functions = {n: _slopes_function(hashable, len(theta), n) for n in _block_lengths(len(depth))}
    except TypeError:
        functions = {n: _slopes_function.__wrapped__(model, len(theta), n) for n in _block_lengths(len(depth))}
    depth, rate = np.ascontiguousarray(depth, np.float64), np.ascontiguousarray(rate, np.float64)
    parameters = np.array(theta, np.float64)
    # They write into these arrays, block by block; the Jacobians (1, k + 2) of a block stand side by side: by the k
    # parameters, then by depth and by rate.
    force, slopes = np.empty(len(depth)), np.empty((len(depth), len(theta) + 2))
    for begin in range(0, len(depth), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        buffer, evaluate = functions[len(depth[rows])].buffer()
        for i, column in enumerate((depth[rows], rate[rows], parameters)):
            buffer.set_arg(i, column.data)
        buffer.set_res(0, force[rows].data)
        buffer.set_res(1, slopes[rows].data)
        evaluate()
    return force, slopes[:, : len(theta)], slopes[:, -2], slopes[:, -1]


@lru_cache(_KEPT_FUNCTIONS)
def _slopes_function(model: ContactModel, parameters: int, count: int) -> Any:
    """Return a CasADi function of so many samples: the force of a model and its derivatives."""
    import casadi

    d, v, p = casadi.SX.sym("d"), casadi.SX.sym("v"), casadi.SX.sym("p", parameters)
    force = contact_force(model, d, v, casadi.vertsplit(p))
    slopes = casadi.densify(casadi.jacobian(force, casadi.vertcat(p, d, v)))
    return casadi.Function("slopes", [d, v, p], [casadi.densify(force), slopes]).map("slopes", "serial", count, [2], [])


def _block_lengths(count: int) -> set[int]:
    """Return the lengths of the blocks of so many samples."""
    return {min(_BLOCK, count), count % _BLOCK} - {0}
