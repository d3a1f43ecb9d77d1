"""The residual of a fit and its exact Jacobian, from the contact model's one expression, over any number of samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, contact_force
from palpate_engine import advance_states
from palpate_kit.kernel import Step

from palpate_fits.columns.column_function import ColumnFunction
from palpate_fits.lazy_kernel import LazyKernel
from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import COLUMNS, PARTS, FitRecord
from palpate_fits.unknowns import EXTRAS

_BLOCK_SAMPLES = 1024  # in one call of the compiled function (choice: memory)
_FACTOR_SAMPLES = 8192  # in one QR factorisation (choice: memory)
_DEPTH_FLOOR = 1e-6  # [transitions], below which no smooth depth is: a power of it has a slope everywhere (choice)
_SQUARES = LossFunction()


def smooth_depth(depth: Any, rate: Any, transition: Any) -> tuple[Any, Any]:
    """Return depth and rate of a contact that sets in gradually: (d + sqrt(d^2 + eps^2))/2 and its time derivative.

    Positive everywhere and smooth, so that one formula and its derivatives hold above and below the surface, and a cost
    has no jump where the surface passes a sample. eps is 1e-3 of the way in contact, 5 um in a palpation of 5 mm, or
    the noise of the height; what it changes dies away as (eps/d)^2.
    """
    root = (depth * depth + transition * transition) ** 0.5
    return 0.5 * (depth + root) + _DEPTH_FLOOR * transition, 0.5 * rate * (1.0 + depth / root)


def reading(
    model: ContactModel, parameters: Sequence[Any], row: Sequence[Any], transition: Any, memory: Any = ()
) -> Any:
    """Return the expected reading of the sensor [N]: F(d, d') at t - tau, plus m d'' + bias + slope t at t.

    `parameters` are the model's theta, then `EXTRAS`: surface [m], bias [N], slope [N/s], tip mass m [kg], delay tau
    [s]. `row` begins with `PARTS`: the height [m] of the tip, rate d' [m/s] and acceleration d'' [m/s^2] of the depth
    d = surface - height, force [N] and time t [s]. The depth at t - tau is d - tau d' + tau^2/2 d''. The `transition`
    is the length eps [m] over which contact sets in (`smooth_depth`), `memory` holds the internal states of a model.
    """
    theta = parameters[: -len(EXTRAS)]
    surface, bias, slope, mass, delay = parameters[-len(EXTRAS) :]
    height, rate, acceleration, _, time = row[: PARTS.index("time") + 1]
    # Depth and rate at t - tau.
    depth = surface - height - delay * rate + 0.5 * delay * delay * acceleration
    delayed_rate = rate - delay * acceleration
    if model.adhesive:  # an adhesive contact pulls below depth 0 and breaks at once, which has no gradual form
        force = contact_force(model, depth, delayed_rate, theta)
    else:
        contact_depth, contact_rate = smooth_depth(depth, delayed_rate, transition)
        states = (memory,) if len(memory) else ()
        force = model.force(contact_depth, contact_rate, theta, *states)
    return force + mass * acceleration + bias + slope * time


class Residual:
    """Weighted residuals (reading less force) of a record, and their derivatives by the free parameters."""

    def __init__(self, model: ContactModel, free: Sequence[int]) -> None:
        self.model = model
        self.free = tuple(free)
        self.parameters = len(model.parameters) + len(EXTRAS)
        self._evaluate = _MemoryResidual(self) if model.memory else _MemorylessResidual(self)

    def blocks(self, record: FitRecord, x: Floats, length: int = _BLOCK_SAMPLES) -> Iterator[tuple[slice, Floats]]:
        """Yield rows, `length` at most, and, for each of them, residual and Jacobian side by side (n, 1 + p)."""
        return self._evaluate.blocks(record, _with_transition(x, record), length)

    def whole(self, record: FitRecord, x: Floats) -> tuple[Floats, Floats]:
        """Return residual (n,) and Jacobian (n, p) of all samples at once."""
        _, values = next(self.blocks(record, x, max(len(record), 1)))
        return values[:, 0], values[:, 1:]

    def errors(self, record: FitRecord, x: Floats) -> Floats:
        """Return the residual (n,) without its Jacobian."""
        return (self if not self.free else self._without_slopes).whole(record, x)[0]

    @cached_property
    def _without_slopes(self) -> Residual:
        return Residual(self.model, ())

    def normal(self, record: FitRecord, x: Floats, loss: LossFunction = _SQUARES) -> Floats:
        """Return [r, J]^T [r, J] (1 + p, 1 + p): all that least squares needs, in memory that does not grow.

        Of several x (m, P) as many matrices (m, 1 + p, 1 + p).
        """
        return self._evaluate.normal(record, x, loss)

    def triangle(self, record: FitRecord, x: Floats, loss: LossFunction) -> Floats:
        """Return R (p + 1, p + 1) of the QR factors of [J, r], for fits whose normal equations are ill-conditioned.

        Its first p columns stand for the Jacobian and its last for the residual: same cost, same gradient, same J^T J,
        in numbers whose range is the square root of that of [r, J]^T [r, J]. Each block is factored together with the R
        of those before it.
        """
        width = 1 + len(self.free)
        factor: Floats = np.zeros((0, width))
        for _, values in self.blocks(record, x, _FACTOR_SAMPLES):
            scaled = loss.scaled(values)
            stacked = np.empty((len(factor) + len(scaled), width))
            stacked[: len(factor)] = factor
            stacked[len(factor) :, :-1] = scaled[:, 1:]
            stacked[len(factor) :, -1] = scaled[:, 0]
            factor = np.asarray(np.linalg.qr(stacked, mode="r"))
        # Fewer samples than unknowns leave rows of zeros.
        padded = np.zeros((width, width))
        padded[: len(factor)] = factor
        return padded


def _weighted_error(residual: Residual, row: Any, x: Any, transition: Any, memory: Any = ()) -> Any:
    """Return the weight times (expected less measured force) of one sample as an expression; `row` as `PARTS`."""
    import casadi as ca

    expected = reading(residual.model, ca.vertsplit(x), ca.vertsplit(row), transition, memory)
    return row[PARTS.index("weight")] * (expected - row[PARTS.index("force")])


class _MemorylessResidual:
    """Residual and slopes of a model without memory: every sample by itself, as one function over columns."""

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        row, x, transition = ca.SX.sym("w", len(PARTS)), ca.SX.sym("x", residual.parameters), ca.SX.sym("eps")
        error = _weighted_error(residual, row, x, transition)
        slopes = [ca.jacobian(error, x[i]) for i in residual.free]
        self._function = ColumnFunction(row, ca.vertcat(x, transition), ca.vertcat(error, *slopes))

    def blocks(self, record: FitRecord, x: Floats, length: int) -> Iterator[tuple[slice, Floats]]:
        """See `Residual.blocks`."""
        for start in range(0, len(record), length):
            rows = slice(start, min(start + length, len(record)))
            part = record.table if rows.stop - start == len(record) else record.table.part(start, rows.stop)
            yield rows, self._function.values(part, x).T

    def normal(self, record: FitRecord, x: Floats, loss: LossFunction) -> Floats:
        """See `Residual.normal`."""
        if loss.kind != "linear":
            return _normal(self, record, x, loss)
        return self._function.products(record.table, _with_transition(x, record))


def _with_transition(x: Floats, record: FitRecord) -> Floats:
    """Return parameters (..., P) with the record's transition [m] behind them (..., P + 1)."""
    extended = np.empty((*x.shape[:-1], x.shape[-1] + 1))
    extended[..., :-1] = x
    extended[..., -1] = record.transition
    return extended


def _normal(
    evaluation: _MemorylessResidual | _MemoryResidual, record: FitRecord, x: Floats, loss: LossFunction
) -> Floats:
    """See `Residual.normal`; from residual and Jacobian of each sample, for every loss."""
    if x.ndim == 2:
        return np.array([_normal(evaluation, record, parameters, loss) for parameters in x])
    products: Floats | float = 0.0
    with np.errstate(all="ignore"):  # the caller checks that all is finite
        for _, values in evaluation.blocks(record, _with_transition(x, record), _FACTOR_SAMPLES):
            scaled = loss.scaled(values)
            products = products + scaled.T @ scaled
    return np.asarray(products)


class _MemoryResidual:
    """Residual and slopes of a model with memory, sample by sample, as one step of a kernel.

    It carries its internal states from sample to sample, with their derivatives by the parameters; they follow their
    rate equation over each interval, in which the tip goes straight from one smooth height to the next: exactly where
    each state fades by itself, else by Runge-Kutta 4. A rate of its own would not add up to the depth.
    """

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        row, x, transition = ca.SX.sym("w", COLUMNS), ca.SX.sym("x", residual.parameters), ca.SX.sym("eps")
        state, next_state, values = _memory_step(residual, row, x, transition)
        self._states = int(state.numel())
        self._kernel = LazyKernel(Step(state, row, ca.vertcat(x, transition), next_state, values))

    def blocks(self, record: FitRecord, x: Floats, length: int) -> Iterator[tuple[slice, Floats]]:
        """See `Residual.blocks`."""
        state = np.zeros(self._states)
        for start in range(0, len(record), length):
            rows = slice(start, min(start + length, len(record)))
            state, values = self._kernel.run(state, record.columns[rows], x)
            yield rows, values

    def normal(self, record: FitRecord, x: Floats, loss: LossFunction) -> Floats:
        """See `Residual.normal`."""
        return _normal(self, record, x, loss)


def _memory_step(residual: Residual, row: Any, x: Any, transition: Any) -> tuple[Any, Any, Any]:
    """Return state, next state, and residual with slopes of one sample, of a model with memory.

    `row` has the sample and its predecessor's motion, `x` the parameters. The state is the memory m (c,) and its slopes
    S = dm/dx (c, p) by the free parameters. With m+ = g(m, x) one interval later, S+ = g_m S + g_x; the residual r(m+,
    x) has the slopes r_x + r_m S+.
    """
    import casadi as ca

    model = residual.model
    count, free = len(model.memory), len(residual.free)
    memory, slopes = ca.SX.sym("m", count), ca.SX.sym("S", count, free)
    next_memory = _next_memory(model, row, x, transition, memory)
    by_parameters = [ca.jacobian(next_memory, x[i]) for i in residual.free]
    direct_slopes = ca.horzcat(*by_parameters) if free else ca.SX.zeros(count, 0)
    next_slopes = ca.jacobian(next_memory, memory) @ slopes + direct_slopes
    # The residual as a function of any memory, with its slopes along x and through the memory.
    error = _weighted_error(residual, row, x, transition, ca.vertsplit(memory))
    by_memory = ca.jacobian(error, memory)
    total = [ca.jacobian(error, x[i]) + by_memory @ slopes[:, j] for j, i in enumerate(residual.free)]
    # The reading is of the end of this sample's interval.
    values = ca.substitute([ca.vertcat(error, *total)], [memory, slopes], [next_memory, next_slopes])[0]
    return ca.vertcat(memory, ca.vec(slopes)), ca.vertcat(next_memory, ca.vec(next_slopes)), values


def _next_memory(model: ContactModel, row: Any, x: Any, transition: Any, memory: Any) -> Any:
    """Return the memory (c,) after the interval that ends with a sample.

    The tip goes straight from the depth at the sample before to that at this one, each `delay` earlier.
    `row` is a row of `FitRecord.columns`.
    """
    import casadi as ca

    # The depth before and after the interval, and the rate between.
    parameters = ca.vertsplit(x)
    theta, surface, delay = parameters[: -len(EXTRAS)], parameters[-len(EXTRAS)], parameters[-1]
    current_rate = row[PARTS.index("rate")]
    interval, height, height_before, rate_before = (row[len(PARTS) + i] for i in range(4))  # the history
    depth_before = surface - height_before - delay * rate_before
    depth = surface - height - delay * current_rate
    rate = (depth - depth_before) / ca.if_else(interval > 0, interval, 1.0)  # the first sample has an interval of 0

    def memory_rate(share: float, state: Any) -> Any:
        """Return the time derivative of a memory (c,) after a share of the interval."""
        smooth, smooth_rate = smooth_depth(depth_before + share * (depth - depth_before), rate, transition)
        return ca.vertcat(*model.memory_rate(smooth, smooth_rate, theta, ca.vertsplit(state)))

    return advance_states(memory_rate, interval, memory)
