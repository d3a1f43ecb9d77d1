"""Covariances as expressions: only one triangle is ever computed, and a scalar measurement takes one vector."""

from __future__ import annotations

from typing import Any

_TINY = 1e-160  # below the root of the smallest normal number


def mirror(matrix: Any) -> Any:
    """The symmetric matrix of an upper triangle (n, n)."""
    import casadi as ca

    return ca.triu2symm(ca.triu(matrix))


def congruence(left: Any, matrix: Any) -> Any:
    """left matrix left^T, of a symmetric matrix."""
    return mirror(left @ matrix @ left.T)


def entry_update(covariance: Any, axis: int, variance: Any, seen: Any) -> tuple[Any, Any, Any]:
    """Gain, covariance after, and inverse variance of the innovation, when entry `axis` of the state was measured.

    With c the column of that entry and S = c_axis + R: P - c c^T/S, whose own row is P R/S, without cancellation.
    Where nothing was seen (0), the gain is 0 and the covariance stays.
    """
    column = covariance[:, axis]
    weight = 1 / (column[axis] + variance)
    gain = column * (seen * weight)
    after = mirror(covariance - gain @ column.T)
    row = column * ((variance + (1 - seen) * column[axis]) * weight)
    after[:, axis], after[axis, :] = row, row.T
    return gain, after, weight


def vector_update(covariance: Any, row: Any, variance: Any, seen: Any) -> tuple[Any, Any, Any]:
    """The same when what was measured is row^T x, for a row (n,)."""
    import casadi as ca

    column = covariance @ row
    weight = 1 / (ca.dot(row, column) + variance)
    gain = column * (seen * weight)
    return gain, mirror(covariance - gain @ column.T), weight


def cholesky(matrix: Any) -> tuple[Any, Any]:
    """Lower root of a symmetric matrix, and whether a pivot was negative; such pivots become 0, not NaN."""
    import casadi as ca

    n = matrix.shape[0]
    root, negative = ca.SX(n, n), ca.SX(0)
    for j in range(n):
        pivot = matrix[j, j] - ca.sumsqr(root[j, :j]) if j else matrix[j, j]
        negative = ca.logic_or(negative, pivot < 0)
        diagonal = ca.sqrt(ca.fmax(pivot, 0.0))
        inverse = (pivot > 0) / ca.fmax(diagonal, _TINY)
        root[j, j] = diagonal
        for i in range(j + 1, n):
            below = matrix[i, j] - ca.dot(root[i, :j], root[j, :j]) if j else matrix[i, j]
            root[i, j] = below * inverse
    return root, negative


def solve_symmetric(matrix: Any, right: Any) -> Any:
    """The solution of a symmetric system by its root, columns and rows first scaled to one; lost directions give 0."""
    import casadi as ca

    n = matrix.shape[0]
    scale = 1.0 / ca.sqrt(ca.fmax(ca.diag(matrix), 1e-300))
    root, _ = cholesky(matrix * (scale @ scale.T))
    inverse = [ca.if_else(root[i, i] > 1e-9, 1.0 / ca.fmax(root[i, i], 1e-9), 0.0) for i in range(n)]
    scaled = ca.diag(scale) @ right
    forward: list[Any] = []
    for i in range(n):
        rest = scaled[i, :] - (root[i, :i] @ ca.vertcat(*forward) if i else 0)
        forward.append(rest * inverse[i])
    backward: list[Any] = [None] * n
    for i in reversed(range(n)):
        rest = forward[i] - (root[i + 1 :, i].T @ ca.vertcat(*backward[i + 1 :]) if i < n - 1 else 0)
        backward[i] = rest * inverse[i]
    return ca.diag(scale) @ ca.vertcat(*backward)
