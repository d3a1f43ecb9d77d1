"""The shift of a model's parameters by a force that is recorded late."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats, Parameter
from palpate_kit.budget.force_sensitivity import Along


def delay_shifts(model: ContactModel, found: Along | None, values: Floats) -> Floats:
    """Shift (k,) of each parameter per second that the force is recorded late [unit/s]; 0 where unknown.

    By least squares along the last samples: a force that is late by tau is F - tau dF/dt, which shifts parameters and
    the unknown surface by -tau (J^T J)^-1 J^T dF/dt. Where the model has a `delay_shift` of its own, that one applies
    to the parameters that it names. What is held fixed has no shift.
    """
    closed = np.array(model.delay_shift(values.tolist()), float)
    slopes = found.answer(-found.change) if found is not None else None
    if found is None or slopes is None:
        return closed
    return np.where(closed != 0.0, closed * found.free[:-1], slopes[: len(values)])


def is_viscous(parameter: Parameter) -> bool:
    """True for a viscosity or a damping, which a delay looks like."""
    return parameter.role == "viscous" or parameter.unit == "Pa*s"
