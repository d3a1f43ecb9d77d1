"""The force of a model along the last samples of a track, with its derivatives by all that it depends on."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats, Tail, contact_force, force_over_time
from palpate_engine import acceleration, force_slopes

from palpate_kit.budget.influence import influence

_STEP = 1e-4  # of a number, for derivatives by differences: a choice between curvature and rounding
_SURFACE_STEP = 1e-6  # [m] likewise, of the surface
_MAX_SAMPLES = 6000  # of a model that remembers, the latest: a choice, for speed


_latest: WeakKeyDictionary[Tail, tuple[ContactModel, Floats, frozenset[str], Along | None]] = WeakKeyDictionary()


class ForceSensitivity(Protocol):
    """Answer of the values of a record to what its force is made of, (n,) each."""

    @property
    def force(self) -> Floats:
        """Force [N]."""
        ...

    @property
    def stretched(self) -> Floats | None:
        """Change of the force [N] per unit of the scale of heights; None where it is not known."""
        ...

    def by_number(self, path: tuple[str, ...], value: float, wide: float = 0.0) -> Floats:
        """Return the derivative of the force by a number among the model's keys; over a `wide` step upwards, if
        given."""
        ...

    def shifts(self, error: Floats) -> Floats | None:
        """Return the shift (k,) of the values by an error (n,) of the force [N]; None where they are indistinct."""
        ...


@dataclass(frozen=True)
class Along:
    """A `ForceSensitivity` along samples: everything is (n,), at those in contact whose motion is known."""

    model: ContactModel
    values: Floats  # (k,)
    jacobian: Floats  # (n, k + 1) by parameters and surface
    force: Floats  # [N]
    change: Floats  # [N/s] dF/dt
    acceleration: Floats  # [m/s^2] z''
    given_way: Floats | None  # [N^2/m] dF/dd F + dF/dd' F'; None for a model that remembers
    stretched: Floats | None  # [N] dF/dd d + dF/dd' d'; the same
    by_rate: Floats | None  # [N s/m] dF/dd'; the same
    _motion: tuple[Floats, Floats, Floats, NDArray[np.bool_]]  # time, depth, rate, rows that count
    held: frozenset[str] = frozenset()  # of the parameters and "surface": what is fixed answers to nothing

    @property
    def time(self) -> Floats:
        """Instants (n,) [s]."""
        return self._motion[0][self._motion[3]]

    @property
    def depth(self) -> Floats:
        """Depth (n,) [m] below the surface."""
        return self._motion[1][self._motion[3]]

    @property
    def rate(self) -> Floats:
        """Rate of the depth (n,) [m/s]."""
        return self._motion[2][self._motion[3]]

    def answer(self, error: Floats) -> Floats | None:
        """Return the shift of parameters and surface (k + 1,) by an error (n,) of the force [N]; None where
        indistinct."""
        return None if self._influence is None else self._influence(error)

    @cached_property
    def _influence(self) -> Callable[[Floats], Floats] | None:
        """The function from an error of the force to the shifts of parameters and surface; None if indistinct."""
        free = self.free
        by_error = influence(self.jacobian[:, free])
        if by_error is None or free.all():
            return by_error

        def shifts(error: Floats) -> Floats:
            moved = np.zeros(len(free))
            moved[free] = by_error(error)
            return moved

        return shifts

    @property
    def free(self) -> NDArray[np.bool_]:
        """(c,) columns that are not held fixed: of k parameters, of the surface, and any that stand behind them."""
        free = np.ones(self.jacobian.shape[1], bool)
        parameters_and_surface = free_columns(self.model, self.held)
        free[: len(parameters_and_surface)] = parameters_and_surface
        return free

    def shifts(self, error: Floats) -> Floats | None:
        """Return the shift (k,) of the parameters by an error (n,) of the force [N]; None where indistinct from the
        surface."""
        shift = self.answer(error)
        return None if shift is None else shift[:-1]

    def by_number(self, path: tuple[str, ...], value: float, wide: float = 0.0) -> Floats:
        """Return the derivative (n,) of the force by a number among the model's keys; over a `wide` step upwards, if
        given."""
        if wide:
            return np.asarray((self._force(with_change(self.model, path, wide)) - self._force(self.model)) / wide)
        step = number_step(value)
        up, down = (self._force(with_change(self.model, path, side * step)) for side in (1.0, -1.0))
        return np.asarray((up - down) / (2 * step))

    def by_height_scale(self) -> Floats:
        """Return the change (n,) of the force [N] per unit of the scale of heights, with which depth and rate grow."""
        if self.stretched is not None:
            return self.stretched
        up, down = (self._force(self.model, 1.0 + side * _STEP) for side in (1.0, -1.0))
        return np.asarray((up - down) / (2 * _STEP))

    def by_beam(self, stiffness: float) -> Floats:
        """Return the derivative (n,) [m] of the force by the stiffness [N/m] of a beam that the depth is less by F/k
        for."""
        if self.given_way is not None:
            return self.given_way / stiffness**2
        time, depth, rate, _ = self._motion
        deeper = np.asarray(force_over_time(self.model, time, depth, rate, self.values.tolist())) / stiffness
        faster = np.gradient(deeper, time)
        up, down = (
            self._forced(self.model, depth + side * _STEP * deeper, rate + side * _STEP * faster)
            for side in (1.0, -1.0)
        )
        return np.asarray((up - down) / (2 * _STEP * stiffness))

    def _force(self, model: Any, scale: float = 1.0) -> Floats:
        _, depth, rate, _ = self._motion
        return self._forced(model, scale * depth, scale * rate)

    def _forced(self, model: Any, depth: Floats, rate: Floats) -> Floats:
        time, _, _, rows = self._motion
        if model.memory:
            return np.asarray(force_over_time(model, time, depth, rate, self.values.tolist()))[rows]
        return np.asarray(contact_force(model, depth[rows], rate[rows], self.values.tolist()))


def free_columns(model: ContactModel, held: Collection[str]) -> NDArray[np.bool_]:
    """Return (k + 1,) which of a model's parameters, and last the surface, are not held fixed."""
    return np.array([name not in held for name in (*(parameter.name for parameter in model.parameters), "surface")])


def along(
    model: ContactModel, tail: Tail, last: Tail, values: Floats, held: frozenset[str] = frozenset()
) -> Along | None:
    """Return the model of a track at its values (k,) along the `last` samples; None where these determine nothing.

    Parameters that are `held` fixed, by name, have no shift. The memory of a model comes from the whole `tail`. Half of
    the diagnoses of a track need the same result: the latest is cached.
    """
    cached = _latest.get(last)
    if cached is None or cached[0] is not model or cached[2] != held or not np.array_equal(cached[1], values):
        cached = _latest[last] = model, values, held, alternative_along(model, tail, last, values, held)
    return cached[3]


def alternative_along(
    model: ContactModel, tail: Tail, last: Tail, values: Floats, held: frozenset[str] = frozenset()
) -> Along | None:
    """Return the result of `along` for a model that only one caller needs; it is not cached."""
    if not np.isfinite(values).all():
        return None
    sensitivity = _remembered(model, tail, last, values) if model.memory else _instantaneous(model, last, values)
    return sensitivity and replace(sensitivity, held=held)


def _instantaneous(model: ContactModel, last: Tail, values: Floats) -> Along | None:
    """Return the sensitivity of a model without memory, by its derivatives."""
    depth = float(last.surface.mean()) - last.position
    tip_acceleration = acceleration(last.time, last.velocity)
    return at_samples(model, (last.time, depth, -last.velocity, tip_acceleration), values)


def at_samples(
    model: ContactModel,
    motion: tuple[Floats, Floats, Floats, Floats],
    values: Floats,
    *,
    air: bool = False,
    held: frozenset[str] = frozenset(),
) -> Along | None:
    """Return the force of a model without memory along a motion, with its derivatives at parameters `values` (k,).

    The motion is time [s], depth [m], its rate d' [m/s] and the tip's acceleration z'' [m/s^2], (n,) each. None where
    no sample is in contact. Samples in the air are left out, or with `air` have no force. Parameters that are `held`
    fixed, by name, have no shift.
    """
    time, depth, rate, second = motion
    inside = np.isfinite(depth) & np.isfinite(rate) & np.isfinite(second) & (depth > 0)
    if not inside.any():
        return None
    rows = np.ones(len(depth), bool) if air else inside

    def filled(column: Floats) -> Floats:
        """Return the rows of the samples that count, zero for those in the air."""
        whole = np.zeros((len(depth), *column.shape[1:]))
        whole[inside] = column
        return np.asarray(whole[rows])

    # dF/dt = dF/dd d' + dF/dd' d'', and the rate of the depth falls as the tip accelerates upwards: d'' = -z''. What a
    # robot gives way by is F/k, so that the force changes by `given_way`/k; `stretched` is the change by a scale of
    # heights, which scales depth and rate.
    force, by_parameter, by_depth, by_rate = force_slopes(model, depth[inside], rate[inside], values.tolist())
    change = by_depth * rate[inside] - by_rate * second[inside]
    return Along(
        model,
        values,
        jacobian=filled(np.column_stack([by_parameter, by_depth])),
        force=filled(force),
        change=filled(change),
        acceleration=second[rows],
        given_way=filled(by_depth * force + by_rate * change),
        stretched=filled(by_depth * depth[inside] + by_rate * rate[inside]),
        by_rate=filled(by_rate),
        _motion=(time, depth, rate, rows),
        held=held,
    )


def _remembered(model: ContactModel, tail: Tail, last: Tail, values: Floats) -> Along | None:
    """Return the sensitivity of a model with memory to its parameters `values` (k,), by differences.

    Its states are integrated along the whole `tail` of the record; the result is at its `last` samples. Samples at the
    ends that have no motion are left out; None where fewer than two of the last have one, or the states change too fast
    for the samples.
    """
    # Of the latest samples, those from the first to the last whose motion is known.
    position, velocity = tail.position[-_MAX_SAMPLES:], tail.velocity[-_MAX_SAMPLES:]
    known_rows = np.flatnonzero(np.isfinite(position) & np.isfinite(velocity))
    if not len(known_rows):
        return None
    whole_rows = slice(known_rows[0], known_rows[-1] + 1)
    time, rate = tail.time[-_MAX_SAMPLES:][whole_rows], -velocity[whole_rows]
    depth = float(last.surface.mean()) - position[whole_rows]
    tip_acceleration = acceleration(time, -rate)
    rows = (time >= last.time[0]) & np.isfinite(tip_acceleration)
    if rows.sum() < 2 or not (np.isfinite(depth).all() and np.isfinite(rate).all()):
        return None

    def force(theta: Floats, deeper: float = 0.0) -> Floats:
        """Return the force (n,) [N] of parameters on the way of the tip, or on one that is `deeper` [m]."""
        return force_over_time(model, time, depth + deeper, rate, theta.tolist())

    try:
        slopes, whole_force = _slopes(force, values), force(values)
    except ValueError:  # states that change too fast for the samples
        return None
    return Along(
        model,
        values,
        jacobian=slopes[rows],
        force=whole_force[rows],
        change=np.gradient(whole_force, time)[rows],
        acceleration=tip_acceleration[rows],
        given_way=None,
        stretched=None,
        by_rate=None,
        _motion=(time, depth, rate, rows),
    )


def _slopes(force: Callable[..., Floats], values: Floats) -> Floats:
    """Return central differences (n, p + 1) of a force (n,) by each parameter (p,), then by the depth.

    `force` is called with parameters, and with a depth [m] that is added. Raises ValueError as it does.
    """
    columns = []
    for i, value in enumerate(values):
        step = np.zeros_like(values)
        step[i] = number_step(value)
        columns.append((force(values + step) - force(values - step)) / (2 * step[i]))
    columns.append((force(values, _SURFACE_STEP) - force(values, -_SURFACE_STEP)) / (2 * _SURFACE_STEP))
    return np.column_stack(columns)


def number_step(value: float) -> float:
    """Return the step of a number for a derivative by differences."""
    return _STEP * (abs(value) or 1.0)


def with_change(part: Any, path: tuple[str, ...], change: float) -> Any:
    """Return settings with a number among their keys changed by so much; not validated, for derivatives."""
    name, *inner_path = path
    inner = getattr(part, name)
    changed = with_change(inner, tuple(inner_path), change) if inner_path else inner + change
    return part.model_copy(update={name: changed})
