"""What a force that is recorded late does to the parameters of a model."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import AlignmentSettings
from palpate.contact import ContactModel, Parameter, force_over_time
from palpate.design import force_slopes
from palpate.result.record import Tail, acceleration
from palpate.result.response import answer

Floats = NDArray[np.float64]

_STEP = 1e-4  # of a parameter, for derivatives of a model that remembers
_SURFACE_STEP = 1e-6  # [m]
_MOST = 6000  # samples


def delay_shifts(model: ContactModel, tail: Tail, last: Tail, values: Floats) -> Floats:
    """Shift (k,) of each parameter per second that the force is recorded late [unit/s]; 0 where unknown.

    By the model's own `delay_shift` where it has one. Else by least squares along the last samples: a force that is
    late by tau is F - tau dF/dt, which shifts parameters and the unknown surface by -tau (J^T J)^-1 J^T dF/dt. What a
    model remembers comes from the whole `tail`.
    """
    closed = np.array(model.delay_shift(values.tolist()))
    if closed.any() or not np.isfinite(values).all():
        return closed
    slopes = _remembered(model, tail, last, values) if model.memory else _instantaneous(model, last, values)
    found = answer(slopes[0], -slopes[1]) if slopes is not None else None
    return closed if found is None else found[: len(values)]


def _instantaneous(model: ContactModel, last: Tail, values: Floats) -> tuple[Floats, Floats] | None:
    """Derivatives of the force by parameters and surface (n, k + 1), and by time (n,) [N/s]."""
    depth, rate = float(last.surface.mean()) - last.position, -last.velocity
    change = -acceleration(last.time, last.velocity)
    usable = np.isfinite(depth) & np.isfinite(rate) & np.isfinite(change) & (depth > 0)
    if not usable.any():
        return None
    _, by_parameter, by_depth, by_rate = force_slopes(model, depth[usable], rate[usable], values.tolist())
    return np.column_stack([by_parameter, by_depth]), by_depth * rate[usable] + by_rate * change[usable]


def _remembered(model: ContactModel, tail: Tail, last: Tail, values: Floats) -> tuple[Floats, Floats] | None:
    """The same of a model with internal states, by differences."""
    time, rate = tail.time[-_MOST:], -tail.velocity[-_MOST:]
    depth = float(last.surface.mean()) - tail.position[-_MOST:]
    rows = time >= last.time[0]
    if rows.sum() < 2 or not (np.isfinite(depth).all() and np.isfinite(rate).all()):
        return None

    def force(theta: Floats, deeper: float = 0.0) -> Floats:
        return force_over_time(model, time, depth + deeper, rate, theta.tolist())

    columns = []
    try:
        for i, value in enumerate(values):
            step = np.zeros_like(values)
            step[i] = _STEP * (abs(value) or 1.0)
            columns.append((force(values + step) - force(values - step)) / (2 * step[i]))
        columns.append((force(values, _SURFACE_STEP) - force(values, -_SURFACE_STEP)) / (2 * _SURFACE_STEP))
        change = np.gradient(force(values), time)
    except ValueError:  # states that change too fast for the samples
        return None
    return np.column_stack(columns)[rows], change[rows]


def is_viscous(parameter: Parameter) -> bool:
    """Whether a parameter is a viscosity or a damping, which a delay looks like."""
    return parameter.role == "viscous" or parameter.unit == "Pa*s"


def timing_uncertainty(settings: AlignmentSettings) -> float | None:
    """Standard uncertainty [s] of the time between force and motion; None where neither side declares any."""
    motion = settings.velocity or settings.position
    if settings.force.uncertainty is None and motion.uncertainty is None:
        return None
    return math.hypot(settings.force.uncertainty or 0.0, motion.uncertainty or 0.0)
