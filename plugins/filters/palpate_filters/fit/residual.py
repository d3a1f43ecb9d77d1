"""The residual of a fit and its exact Jacobian, from the contact model's one expression, over any number of samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, contact_force

from palpate_filters.fit.loss import LossFunction
from palpate_filters.fit.record import COLUMNS, FitRecord
from palpate_filters.fit.unknowns import EXTRAS

_BLOCK = 1024  # samples in one call
_BLOCKS_IN_A_FACTOR = 8


def touching(depth: Any, rate: Any, transition: Any) -> tuple[Any, Any]:
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
    smooth, smooth_rate = touching(depth, rate - delay * acceleration, transition)
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
        self._evaluate = _Remembering(self) if model.memory else _Mapped(self)

    def blocks(self, record: FitRecord, x: Floats) -> Iterator[tuple[slice, Floats]]:
        """Rows and, for each of them, residual and Jacobian side by side (n, 1 + p); overwritten by the next block."""
        return self._evaluate.blocks(record, np.concatenate([x, [record.transition]]))

    def whole(self, record: FitRecord, x: Floats) -> tuple[Floats, Floats]:
        """Residual (n,) and Jacobian (n, p)."""
        both = np.empty((len(record), 1 + len(self.free)))
        for rows, values in self.blocks(record, x):
            both[rows] = values
        return both[:, 0], both[:, 1:]

    def triangle(self, record: FitRecord, x: Floats, loss: LossFunction) -> Floats:
        """R (p + 1, p + 1) of the QR factors of [J, r]: all that least squares needs, in memory that does not grow.

        Its first p columns stand for the Jacobian and its last for the residual: same cost, same gradient, same J^T J.
        """
        width = 1 + len(self.free)
        waiting: list[Floats] = [np.zeros((0, width))]
        for _, values in self.blocks(record, x):
            scaled = loss.scaled(values)
            waiting.append(np.concatenate([scaled[:, 1:], scaled[:, :1]], axis=1))
            if len(waiting) > _BLOCKS_IN_A_FACTOR:
                waiting = [_triangular(np.concatenate(waiting))]
        found = _triangular(np.concatenate(waiting))
        padded = np.zeros((width, width))
        padded[: len(found)] = found
        return padded


def _triangular(matrix: Floats) -> Floats:
    """R of the QR factors."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def _symbols(residual: Residual) -> tuple[Any, Any, Any]:
    import casadi as ca

    return ca.SX.sym("w", COLUMNS), ca.SX.sym("x", residual.parameters), ca.SX.sym("eps")


def _outputs(residual: Residual, row: Any, x: Any, transition: Any, memory: Any = ()) -> Any:
    import casadi as ca

    expected = reading(residual.model, ca.vertsplit(x), ca.vertsplit(row), transition, memory)
    return row[5] * (expected - row[3])


class _Mapped:
    """Models without memory: each sample by itself."""

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        row, x, transition = _symbols(residual)
        error = _outputs(residual, row, x, transition)
        slopes = [ca.jacobian(error, x[i]) for i in residual.free]
        inputs = [row, ca.vertcat(x, transition)]
        one = ca.Function("residual", inputs, [ca.densify(ca.vertcat(error, *slopes))], {"cse": True})
        self._rows = np.zeros((_BLOCK, COLUMNS))
        self._x = np.zeros(residual.parameters + 1)
        self._values = np.zeros((_BLOCK, 1 + len(residual.free)))
        self._mapped: Any = one.map("residuals", "serial", _BLOCK, [1], [])
        self._buffer: Any
        self._buffer, self._trigger = self._mapped.buffer()
        self._buffer.set_arg(0, memoryview(self._rows.data))
        self._buffer.set_arg(1, memoryview(self._x.data))
        self._buffer.set_res(0, memoryview(self._values.data))

    def blocks(self, record: FitRecord, x: Floats) -> Iterator[tuple[slice, Floats]]:
        """See `Residual.blocks`."""
        self._x[:] = x
        for start in range(0, len(record), _BLOCK):
            rows = slice(start, min(start + _BLOCK, len(record)))
            count = rows.stop - start
            self._rows[:count] = record.columns[rows]
            self._rows[count:] = self._rows[0]
            self._trigger()
            yield rows, self._values[:count]


class _Remembering:
    """Models with internal states: carried from sample to sample, with their derivatives by the parameters.

    The states follow their rate equation by Runge-Kutta 4 over each interval, depth and rate linear within it.
    """

    def __init__(self, residual: Residual) -> None:
        import casadi as ca

        model = residual.model
        row, x, transition = _symbols(residual)
        count, free = len(model.memory), len(residual.free)
        memory, slopes = ca.SX.sym("m", count), ca.SX.sym("S", count, free)
        after = _advanced(model, row, x, transition, memory)
        forward = ca.horzcat(*[ca.jacobian(after, x[i]) for i in residual.free]) if free else ca.SX.zeros(count, 0)
        slopes_after = ca.jacobian(after, memory) @ slopes + forward
        error = _outputs(residual, row, x, transition, ca.vertsplit(memory))
        by_memory = ca.jacobian(error, memory)
        total = [ca.jacobian(error, x[i]) + by_memory @ slopes[:, j] for j, i in enumerate(residual.free)]
        values = ca.vertcat(error, *total)
        # The reading is taken from the state after this sample's interval.
        values = ca.substitute([values], [memory, slopes], [after, slopes_after])[0]
        state = ca.vertcat(memory, ca.vec(slopes))
        following = ca.vertcat(after, ca.vec(slopes_after))
        inputs = [state, row, ca.vertcat(x, transition)]
        one = ca.Function("residual", inputs, [ca.densify(following), ca.densify(values)], {"cse": True})
        self._chain: Any = one.mapaccum("residuals", _BLOCK, [0], [0])
        self._width = 1 + free
        self._state = np.zeros(count * (1 + free))
        self._rows = np.zeros((_BLOCK, COLUMNS))
        self._x = np.zeros((_BLOCK, residual.parameters + 1))
        self._states = np.zeros((_BLOCK, len(self._state)))
        self._values = np.zeros((_BLOCK, self._width))
        self._buffer: Any
        self._buffer, self._trigger = self._chain.buffer()
        for i, array in enumerate((self._state, self._rows, self._x)):
            self._buffer.set_arg(i, memoryview(array.data))
        for i, array in enumerate((self._states, self._values)):
            self._buffer.set_res(i, memoryview(array.data))

    def blocks(self, record: FitRecord, x: Floats) -> Iterator[tuple[slice, Floats]]:
        """See `Residual.blocks`."""
        self._x[:] = x
        self._state[:] = 0.0
        for start in range(0, len(record), _BLOCK):
            rows = slice(start, min(start + _BLOCK, len(record)))
            count = rows.stop - start
            self._rows[:count] = record.columns[rows]
            self._rows[count:] = self._rows[0]
            self._trigger()
            self._state[:] = self._states[count - 1]
            yield rows, self._values[:count]


def _advanced(model: ContactModel, row: Any, x: Any, transition: Any, memory: Any) -> Any:
    """Memory one interval later."""
    import casadi as ca

    parameters = ca.vertsplit(x)
    theta, surface, delay = parameters[: -len(EXTRAS)], parameters[-len(EXTRAS)], parameters[-1]

    def slope(share: float, state: Any) -> Any:
        height = row[7] + share * (row[0] - row[7])
        rate = row[8] + share * (row[1] - row[8])
        smooth, smooth_rate = touching(surface - height - delay * rate, rate, transition)
        return ca.vertcat(*model.memory_rate(smooth, smooth_rate, theta, ca.vertsplit(state)))

    step = row[6]
    one = slope(0.0, memory)
    two = slope(0.5, memory + 0.5 * step * one)
    three = slope(0.5, memory + 0.5 * step * two)
    four = slope(1.0, memory + step * three)
    return memory + step / 6.0 * (one + 2 * two + 2 * three + four)
