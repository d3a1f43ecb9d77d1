"""Influence of a small error of the force on a least-squares estimate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from palpate import ContactModel, Floats

from palpate_kit.numerics.normal_equations import symmetric_inverse

_INDISTINCT = 1e-6  # ratio of singular values below which parameters and surface cannot be distinguished


def answer(jacobian: Floats, error: Floats) -> Floats | None:
    """Return the shift of parameters and surface (k + 1,) by an error (n,) of the force [N].

    None where the force does not depend on one of them.
    """
    shifts = influence(jacobian)
    return None if shifts is None else shifts(error)


def influence(jacobian: Floats) -> Callable[[Floats], Floats] | None:
    """Return the function from an error (n,) of the force [N] to the shift (k + 1,) of parameters and surface.

    The shift is (J^T J)^-1 J^T f, by the derivatives J (n, k + 1) of the force. None for no more samples than columns,
    or a column of zeros. A direction in which parameters and surface cannot be distinguished, such as a viscosity and
    the surface at one speed, has no shift; the others keep theirs.
    """
    if len(jacobian) <= jacobian.shape[1]:
        return None
    scale = np.linalg.norm(jacobian, axis=0)
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        return None
    # Sums and a small explicit inverse: the same bits on every run.
    scaled_columns = jacobian / scale
    normal_matrix = (scaled_columns[:, :, None] * scaled_columns[:, None, :]).sum(axis=0)
    # The condition number of J^T J is the square of that of J.
    if np.linalg.cond(normal_matrix) > _INDISTINCT**-2:
        inverse = symmetric_inverse(normal_matrix, _INDISTINCT**2)
        return lambda error: np.asarray(inverse @ (scaled_columns * error[:, None]).sum(axis=0) / scale)
    return lambda error: np.asarray(
        np.linalg.solve(normal_matrix, (scaled_columns * error[:, None]).sum(axis=0)) / scale
    )


def effects_by_name(model: ContactModel, shifts: Floats | None) -> dict[str, float] | None:
    """Sizes of shifts (k,) of the parameters, or (k + 1,) with the surface, by name; None where they are not known."""
    if shifts is None:
        return None
    return {p.name: abs(float(shift)) for p, shift in zip(model.parameters, shifts, strict=False)}
