"""The residual of a fit and its exact Jacobian, from the contact model's one expression, over any number of samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, contact_force
from palpate_kit.kernel import Step

from palpate_fits.columns.column_function import ColumnFunction
from palpate_fits.fading_states import fade_states
from palpate_fits.lazy_kernel import LazyKernel
from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import COLUMNS, PARTS, FitRecord
from palpate_fits.unknowns import EXTRAS

_BLOCK = 1024  # samples in one call
_FACTORED = 8192  # samples in one QR factorisation
_SQUARES = LossFunction()


def smooth_depth(depth: Any, rate: Any, transition: Any) -> tuple[Any, Any]:
    """Depth and its rate where contact sets in gradually: (d + sqrt(d^2 + eps^2))/2 and its time derivative.

    Positive everywhere and smooth, so that one formula and its derivatives hold above and below the surface, and a cost
    has no jump where the surface passes a sample. eps is 1e-3 of the way in contact, 5 um in a palpation of 5 mm, or
    the noise of the height; what it changes dies away as (eps/d)^2.
    """
    root = (depth * depth + transition * transition) ** 0.5
    return 0.5 * (depth + root) + 1e-6 * transition, 0.5 * rate * (1.0 + depth / root)


def reading(
    model: ContactModel, parameters: Sequence[Any], row: Sequence[Any], transition: Any, memory: Any = ()
) -> Any:
    """What the sensor should read [N]: F(d, d') + m d'' + bias + slope t, of the motion `delay` earlier.

    `parameters` are the model's, then surface, bias, slope, tip mass, delay; `row` begins with height, rate,
    acceleration, force, time. The motion at t - tau is d - tau d' + tau^2/2 d''.
    """
    theta, (surface, bias, slope, mass, delay) = parameters[: -len(EXTRAS)], parameters[-len(EXTRAS) :]
    height, rate, acceleration, time = row[0], row[1], row[2], row[4]
    depth = surface - height - delay * rate + 0.5 * delay * delay * acceleration
    smooth, smooth_rate = smooth_depth(depth, rate - delay * acceleration, transition)
    if model.adhesive:  # it pulls below depth 0, and lets go at once
        return (
            contact_force(model, depth, rate - delay * acceleration, theta) + mass * acceleration + bias + slope * time
        )
    force = model.force(smooth, smooth_rate, theta, memory) if len(memory) else model.force(smooth, smooth_rate, theta)
    return force + mass * acceleration + bias + slope * time


class Residual:
    """Weighted residuals (reading less force) of a record, and their derivatives by the free parameters."""

    def __init__(self, model: ContactModel, free: Sequence[int]) -> None:
        self.model = model
        self.free = tuple(free)
        self.parameters = len(model.parameters) + len(EXTRAS)
        self._evaluate = _MemoryResidual(self) if model.memory else _MemorylessResidual(self)

    def blocks(self, record: FitRecord, x: Floats, length: int = _BLOCK) -> Iterator[tuple[slice, Floats]]:
        """Rows, `length` at most, and, for each of them, residual and Jacobian side by side (n, 1 + p)."""
        return self._evaluate.blocks(record, _with_transition(x, record), length)

    def whole(self, record: FitRecord, x: Floats) -> tuple[Floats, Floats]:
        """Residual (n,) and Jacobian (n, p)."""
        both = [values.T for _, values in self.blocks(record, x, max(len(record), 1))]
        return both[0][0], both[0][1:].T

    def errors(self, record: FitRecord, x: Floats) -> Floats:
        """Residual (n,) alone."""
        return (self if not self.free else self._alone).whole(record, x)[0]

    @cached_property
    def _alone(self) -> Residual:
        return Residual(self.model, ())

    def normal(self, record: FitRecord, x: Floats, loss: LossFunction = _SQUARES) -> Floats:
        """[r, J]^T [r, J] (1 + p, 1 + p): all that least squares needs, in memory that does not grow.

        Of several x (m, P) as many matrices (m, 1 + p, 1 + p).
        """
        return self._evaluate.normal(record, x, loss)

    def triangle(self, record: FitRecord, x: Floats, loss: LossFunction) -> Floats:
        """R (p + 1, p + 1) of the QR factors of [J, r]: the same in numbers of half the range, for what is ill-posed.

        Its first p columns stand for the Jacobian and its last for the residual: same cost, same gradient, same J^T J.
        """
        width = 1 + len(self.free)
        found: Floats = np.zeros((0, width))
        for _, values in self.blocks(record, x, _FACTORED):
            scaled = loss.scaled(values)
            joined = np.empty((len(found) + len(scaled), width))
            joined[: len(found)] = found
            joined[len(found) :, :-1], joined[len(found) :, -1] = scaled[:, 1:], scaled[:, 0]
            found = np.asarray(np.linalg.qr(joined, mode="r"))
        padded = np.zeros((width, width))
        padded[: len(found)] = found
        return padded


def _outputs(residual: Residual, row: Any, x: Any, transition: Any, memory: Any = ()) -> Any:
    import casadi as ca

    expected = reading(residual.model, ca.vertsplit(x), ca.vertsplit(row), transition, memory)
    return row[5] * (expected - row[3])


class _MemorylessResidual:
    """Residual and slopes of a model without memory: every sample by itself, as one function over columns."""

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        row, x, transition = ca.SX.sym("w", len(PARTS)), ca.SX.sym("x", residual.parameters), ca.SX.sym("eps")
        error = _outputs(residual, row, x, transition)
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
    both = np.empty((*x.shape[:-1], x.shape[-1] + 1))
    both[..., :-1], both[..., -1] = x, record.transition
    return both


def _normal(
    evaluation: _MemorylessResidual | _MemoryResidual, record: FitRecord, x: Floats, loss: LossFunction
) -> Floats:
    """See `Residual.normal`; from the values, for every loss."""
    if x.ndim == 2:
        return np.array([_normal(evaluation, record, one, loss) for one in x])
    found: Floats | float = 0.0
    with np.errstate(all="ignore"):  # what is not finite is the caller's to see
        for _, values in evaluation.blocks(record, _with_transition(x, record), _FACTORED):
            scaled = loss.scaled(values)
            found = found + scaled.T @ scaled
    return np.asarray(found)


class _MemoryResidual:
    """Residual and slopes of a model with memory, sample by sample, as one step of a kernel.

    It carries its internal states from sample to sample, with their derivatives by the parameters; they follow their
    rate equation over each interval, in which the tip goes straight from one smooth height to the next: exactly where
    each state fades by itself, else by Runge-Kutta 4. A rate of its own would not add up to the depth.
    """

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        row, x, transition = ca.SX.sym("w", COLUMNS), ca.SX.sym("x", residual.parameters), ca.SX.sym("eps")
        state, following, values = _remembering(residual, row, x, transition)
        self._states = int(state.numel())
        self._kernel = LazyKernel(Step(state, row, ca.vertcat(x, transition), following, values))

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


def _remembering(residual: Residual, row: Any, x: Any, transition: Any) -> tuple[Any, Any, Any]:
    """State, the one after it, residual and slopes: of a model with memory."""
    import casadi as ca

    model = residual.model
    count, free = len(model.memory), len(residual.free)
    memory, slopes = ca.SX.sym("m", count), ca.SX.sym("S", count, free)
    after = _advanced(model, row, x, transition, memory)
    forward = ca.horzcat(*[ca.jacobian(after, x[i]) for i in residual.free]) if free else ca.SX.zeros(count, 0)
    slopes_after = ca.jacobian(after, memory) @ slopes + forward
    error = _outputs(residual, row, x, transition, ca.vertsplit(memory))
    by_memory = ca.jacobian(error, memory)
    total = [ca.jacobian(error, x[i]) + by_memory @ slopes[:, j] for j, i in enumerate(residual.free)]
    # The reading is taken from the state after this sample's interval.
    values = ca.substitute([ca.vertcat(error, *total)], [memory, slopes], [after, slopes_after])[0]
    return ca.vertcat(memory, ca.vec(slopes)), ca.vertcat(after, ca.vec(slopes_after)), values


def _advanced(model: ContactModel, row: Any, x: Any, transition: Any, memory: Any) -> Any:
    """Memory one interval later."""
    import casadi as ca

    parameters = ca.vertsplit(x)
    theta, surface, delay = parameters[: -len(EXTRAS)], parameters[-len(EXTRAS)], parameters[-1]

    step = row[6]
    before, after = (surface - height - delay * rate for height, rate in ((row[8], row[9]), (row[7], row[1])))
    rate = (after - before) / ca.if_else(step > 0, step, 1.0)

    def slope(share: float, state: Any) -> Any:
        smooth, smooth_rate = smooth_depth(before + share * (after - before), rate, transition)
        return ca.vertcat(*model.memory_rate(smooth, smooth_rate, theta, ca.vertsplit(state)))

    if (found := fade_states(slope, step, memory)) is not None:
        return found
    one = slope(0.0, memory)
    two = slope(0.5, memory + 0.5 * step * one)
    three = slope(0.5, memory + 0.5 * step * two)
    four = slope(1.0, memory + step * three)
    return memory + step / 6.0 * (one + 2 * two + 2 * three + four)
