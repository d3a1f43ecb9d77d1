"""Covariances as expressions: only one triangle is ever computed, and a scalar measurement takes one vector."""

from __future__ import annotations

from typing import Any

from palpate_filters.step_limits import SMALLEST_VARIANCE

_SMALLEST_PIVOT = 1e-160  # a choice below the root of the smallest normal number, 2e-308: keeps quotients finite
_LOST_PIVOT = 1e-9  # of a scaled covariance, a choice: 1e-18 of a variance is below the rounding of a double


def mirror(matrix: Any) -> Any:
    """Return the symmetric matrix of an upper triangle (n, n)."""
    import casadi as ca

    return ca.triu2symm(ca.triu(matrix))


def congruence(left: Any, matrix: Any) -> Any:
    """Return left matrix left^T, of a symmetric matrix."""
    return mirror(left @ matrix @ left.T)


def entry_update(covariance: Any, axis: int, variance: Any, is_present: Any) -> tuple[Any, Any, Any]:
    """Return gain, covariance after, and inverse variance of the innovation, for a measurement of entry `axis`.

    With c the column of that entry and S = c_axis + R: P - c c^T/S, whose own row is P R/S, without cancellation.
    Without a measurement (`is_present` 0) the gain is 0 and the covariance stays.
    """
    column = covariance[:, axis]
    weight = 1 / (column[axis] + variance)
    gain = column * (is_present * weight)
    after = mirror(covariance - gain @ column.T)
    row = column * ((variance + (1 - is_present) * column[axis]) * weight)
    after[:, axis], after[axis, :] = row, row.T
    return gain, after, weight


def vector_update(covariance: Any, row: Any, variance: Any, is_present: Any) -> tuple[Any, Any, Any]:
    """Return the same for a measurement of row^T x, for a row (n,)."""
    import casadi as ca

    column = covariance @ row
    weight = 1 / (ca.dot(row, column) + variance)
    gain = column * (is_present * weight)
    return gain, mirror(covariance - gain @ column.T), weight


def cholesky(matrix: Any) -> tuple[Any, Any]:
    """Return Cholesky's lower root L of a symmetric matrix L L^T, and 1 if a pivot was negative.

    Such pivots, and their columns of L, become 0 and not NaN.
    """
    import casadi as ca

    n = matrix.shape[0]
    root, negative = ca.SX(n, n), ca.SX(0)
    for j in range(n):
        pivot = matrix[j, j] - ca.sumsqr(root[j, :j]) if j else matrix[j, j]
        negative = ca.logic_or(negative, pivot < 0)
        diagonal = ca.sqrt(ca.fmax(pivot, 0.0))
        inverse = (pivot > 0) / ca.fmax(diagonal, _SMALLEST_PIVOT)
        root[j, j] = diagonal
        for i in range(j + 1, n):
            remainder = matrix[i, j] - ca.dot(root[i, :j], root[j, :j]) if j else matrix[i, j]
            root[i, j] = remainder * inverse
    return root, negative


def solve_symmetric(matrix: Any, right: Any) -> Any:
    """Return the solution of a symmetric system by its Cholesky root, its diagonal scaled to 1.

    A direction whose pivot is below `_LOST_PIVOT`, so lost in rounding, gets 0.
    """
    import casadi as ca

    n = matrix.shape[0]
    scale = 1.0 / ca.sqrt(ca.fmax(ca.diag(matrix), SMALLEST_VARIANCE))
    root, _ = cholesky(matrix * (scale @ scale.T))
    pivots = [root[i, i] for i in range(n)]
    inverse = [ca.if_else(pivot > _LOST_PIVOT, 1.0 / ca.fmax(pivot, _LOST_PIVOT), 0.0) for pivot in pivots]
    # Forward and backward substitution.
    scaled = ca.diag(scale) @ right
    forward: list[Any] = []
    for i in range(n):
        remainder = scaled[i, :] - (root[i, :i] @ ca.vertcat(*forward) if i else 0)
        forward.append(remainder * inverse[i])
    backward: list[Any] = [None] * n
    for i in reversed(range(n)):
        remainder = forward[i] - (root[i + 1 :, i].T @ ca.vertcat(*backward[i + 1 :]) if i < n - 1 else 0)
        backward[i] = remainder * inverse[i]
    return ca.diag(scale) @ ca.vertcat(*backward)
