"""Solvers: four ways to the same minimum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

from palpate_filters.fit.loss import LossFunction
from palpate_filters.fit.record import FitRecord
from palpate_filters.fit.refusal import NotFitted
from palpate_filters.fit.residual import Residual, reading
from palpate_filters.fit.unknowns import Unknowns
from palpate_filters.least_squares import least_squares

_LARGEST_IPOPT = 2_000_000  # samples; its graph holds every one of them several times


@dataclass(frozen=True)
class Solution:
    """A minimum."""

    x: Floats  # (P,) all parameters
    cost: float  # half of the sum of losses
    evaluations: int
    converged: bool
    moved: Floats | None = None  # (P,) by what the parameters have been corrected since; None: by nothing

    @property
    def least(self) -> Floats:
        """(P,) where the sum of losses is least."""
        return self.x if self.moved is None else self.x - self.moved


def descend(residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction) -> Solution:
    """The minimum near a start, by the fastest solver for the model."""
    solve = solve_trf if residual.model.memory else solve_lm
    return solve(residual, unknowns, record, x, loss)


def solve_lm(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
    gain: float = 1e-22,
) -> Solution:
    """Levenberg and Marquardt on the normal equations, which one compiled function sums up over all samples."""
    free = list(residual.free)
    full = x.copy()

    def normal(values: Floats) -> Floats:
        full[free] = values
        return residual.normal(record, full, loss)

    found = least_squares(normal, x[free], *unknowns.bounds(free), gain=gain)
    full[free] = found.x
    return Solution(full, found.cost, found.evaluations, found.converged)


def solve_trf(
    residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction, most: int = 200
) -> Solution:
    """Trust-region reflective (Branch, Coleman and Li 1999; scipy), on the triangular factor of [J, r].

    The factor has the cost, the gradient and the J^T J of the whole, so the steps are those of the whole problem.
    """
    from scipy import optimize

    free = list(residual.free)
    low, high = unknowns.bounds(free)
    seen = _LastTriangle(residual, record, x, loss)
    if not free:
        return Solution(x, 0.5 * float(seen.triangle(x[free])[-1, -1] ** 2), 1, True)
    first = seen.triangle(x[free])
    # In units of the first residual, so that tolerances mean the same for every record.
    scale, size = _scales(first, x[free]), max(abs(float(first[-1, -1])), 1e-300)
    solve: Any = optimize.least_squares  # its annotations know no function for the Jacobian
    found = solve(
        lambda p: seen.triangle(p * scale)[:, -1] / size,
        _strictly_inside(x[free], low, high) / scale,
        lambda p: seen.triangle(p * scale)[:, :-1] * scale / size,
        bounds=(low / scale, high / scale),
        method="trf",
        ftol=1e-12,
        xtol=1e-10,
        gtol=1e-9,
        max_nfev=most,
    )
    full = x.copy()
    full[free] = np.clip(found.x * scale, low, high)
    return Solution(full, float(found.cost) * size**2, int(found.nfev), bool(found.status > 0))


class _LastTriangle:
    """Remembers the last triangle: residual and Jacobian are asked for one after the other."""

    def __init__(self, residual: Residual, record: FitRecord, x: Floats, loss: LossFunction) -> None:
        self._residual, self._record, self._x, self._loss = residual, record, x.copy(), loss
        self._last: tuple[bytes, Floats] | None = None

    def triangle(self, free: Floats) -> Floats:
        key = np.asarray(free).tobytes()
        if self._last is None or self._last[0] != key:
            self._x[list(self._residual.free)] = free
            self._last = key, self._residual.triangle(self._record, self._x, self._loss)
        return self._last[1]


def _scales(triangle: Floats, values: Floats) -> Floats:
    """Typical steps: what moves the residual by its own size over the square root of the samples; never 0."""
    lengths = np.sqrt(np.sum(triangle[:, :-1] ** 2, axis=0))
    size = max(abs(float(triangle[-1, -1])), 1e-12)
    fallback = np.where(values != 0, np.abs(values), 1.0)
    return np.where(lengths > 0, size / np.where(lengths > 0, lengths, 1.0), fallback)


def _strictly_inside(x: Floats, low: Floats, high: Floats) -> Floats:
    """Trust-region reflective starts inside the bounds, not on them."""
    width = np.where(np.isfinite(high - low), high - low, np.maximum(np.abs(x), 1.0))
    margin = 1e-9 * width
    return np.clip(x, np.where(np.isfinite(low), low + margin, low), np.where(np.isfinite(high), high - margin, high))


def solve_varpro(
    residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, linear: Sequence[int]
) -> Solution:
    """Variable projection (Golub and Pereyra 1973): a search over the surface alone, all others solved for linearly.

    `residual` is free in exactly the `linear` unknowns. For each surface the triangular factor of [J, r] at zero gives
    their best values, within bounds, and the cost left.
    """
    from scipy.optimize import lsq_linear, minimize_scalar

    place = unknowns.index("surface")
    low, high = unknowns.bounds(linear)
    count, zero = 0, x.copy()
    zero[list(linear)] = 0.0

    def projected(surface: float) -> tuple[float, Floats]:
        nonlocal count
        count += 1
        zero[place] = surface
        factor = residual.triangle(record, zero, LossFunction())
        scale = np.sqrt(np.sum(factor[:, :-1] ** 2, axis=0))
        scale[scale == 0] = 1.0
        matrix, target = factor[:, :-1] / scale, -factor[:, -1]
        found = np.linalg.lstsq(matrix, target, rcond=None)[0]
        if np.any(found / scale < low) or np.any(found / scale > high):
            found = lsq_linear(matrix, target, (low * scale, high * scale), method="bvls").x
        left = matrix @ found - target
        return 0.5 * float(left @ left), np.clip(found / scale, low, high)

    item = unknowns.items[place]
    surface = x[place]
    if item.free:
        reach = max(float(np.ptp(record.height)), 1e-12)
        for width in (0.02, 0.1, 0.5, 2.0):
            edges = item.inside(surface - width * reach), item.inside(surface + width * reach)
            tolerance = {"xatol": 1e-7 * reach}
            minimum: Any = minimize_scalar(lambda z: projected(z)[0], bounds=edges, method="bounded", options=tolerance)
            surface = float(minimum.x)
            if edges[0] + 1e-3 * width * reach < surface < edges[1] - 1e-3 * width * reach:
                break  # a minimum within, not an edge that it was cut off at
    cost, values = projected(surface)
    full = x.copy()
    full[place], full[list(linear)] = surface, values
    return Solution(full, cost, count, True)


def solve_ipopt(residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction) -> Solution:
    """Interior point with exact Hessian (Waechter and Biegler 2006; IPOPT through CasADi)."""
    return build_ipopt(residual, unknowns, record, x, loss)()


def build_ipopt(
    residual: Residual, unknowns: Unknowns, record: FitRecord, x: Floats, loss: LossFunction
) -> Callable[[], Solution]:
    """The problem as a graph over all samples, and what solves it from `x`; raises NotFitted for too many samples."""
    import casadi as ca

    if len(record) > _LARGEST_IPOPT:
        raise NotFitted("not-fitted", f'solver "ipopt" takes up to {_LARGEST_IPOPT} samples; "trf" takes any number')
    free = list(residual.free)
    low, high = unknowns.bounds(free)
    triangle = residual.triangle(record, x, loss)
    scale = np.maximum(_scales(triangle, x[free]), 1e-6 * np.abs(x[free]))
    row, all_x = ca.SX.sym("w", record.columns.shape[1]), ca.SX.sym("x", len(x))
    error = row[5] * (reading(residual.model, ca.vertsplit(all_x), ca.vertsplit(row), record.transition) - row[3])
    one = ca.Function("loss", [row, all_x], [_symbolic_loss(error, loss)])
    step: Any = ca.MX.sym("p", len(free))
    parameters: Any = ca.MX(ca.DM(x))
    for j, place in enumerate(free):
        parameters[place] = x[place] + scale[j] * step[j]
    total = ca.sum2(one.map("losses", "serial", len(record), [1], [])(ca.DM(record.columns.T), parameters))
    quiet: Any = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": 0,
        "ipopt.tol": 1e-10,
        "error_on_fail": False,
    }
    problem: Any = {"x": step, "f": 0.5 * total / max(float(triangle[-1, -1]) ** 2, 1e-300)}
    solver: Any = ca.nlpsol("fit", "ipopt", problem, quiet)
    lower, upper = ((edge - x[free]) / scale for edge in (low, high))

    def solve() -> Solution:
        found = solver(x0=0, lbx=ca.DM(lower), ubx=ca.DM(upper))
        full = x.copy()
        full[free] = np.clip(x[free] + scale * np.array(found["x"]).ravel(), low, high)
        stats = solver.stats()
        left = residual.triangle(record, full, loss)[:, -1]
        return Solution(full, 0.5 * float(left @ left), int(stats["iter_count"]), bool(stats["success"]))

    return solve


def _symbolic_loss(error: Any, loss: LossFunction) -> Any:
    import casadi as ca

    size = ca.fabs(error) / loss.scale
    if loss.kind == "huber":
        return loss.scale**2 * ca.if_else(size <= 1, size**2, 2 * size - 1)
    if loss.kind == "soft-l1":
        return 2 * loss.scale**2 * (ca.sqrt(1 + size**2) - 1)
    return error**2
