"""The shift of a model's parameters by a force that is recorded late."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats, Parameter
from palpate_kit.budget.force_sensitivity import Along


def delay_shifts(model: ContactModel, sensitivity: Along | None, values: Floats) -> Floats:
    """Return the shift (k,) of each parameter per second that the force is late [unit/s]; 0 where unknown.

    By least squares along the last samples: a force that is late by tau is F - tau dF/dt, which shifts parameters and
    the unknown surface by -tau (J^T J)^-1 J^T dF/dt. A model's own `delay_shift` applies to the parameters that it
    names. A parameter that is held fixed has no shift.
    """
    closed_form = np.array(model.delay_shift(values.tolist()), float)
    slopes = sensitivity.answer(-sensitivity.change) if sensitivity is not None else None
    if sensitivity is None or slopes is None:
        return closed_form
    return np.where(closed_form != 0.0, closed_form * sensitivity.free[:-1], slopes[: len(values)])


def is_viscous(parameter: Parameter) -> bool:
    """Return True for a viscosity or a damping, which a delay looks like."""
    return parameter.role == "viscous" or parameter.unit == "Pa*s"
