"""What a force that is recorded late does to the parameters of a model."""

from __future__ import annotations

import math

import numpy as np

from palpate.alignment import AlignmentSettings
from palpate.contact import ContactModel, Parameter
from palpate.result.along import Along
from palpate.result.response import answer
from palpate.vectors import Floats


def delay_shifts(model: ContactModel, found: Along | None, values: Floats) -> Floats:
    """Shift (k,) of each parameter per second that the force is recorded late [unit/s]; 0 where unknown.

    By least squares along the last samples: a force that is late by tau is F - tau dF/dt, which shifts parameters and
    the unknown surface by -tau (J^T J)^-1 J^T dF/dt. Where the model has a `delay_shift` of its own, that one holds for
    the parameters that it names.
    """
    closed = np.array(model.delay_shift(values.tolist()), float)
    slopes = answer(found.jacobian, -found.change) if found is not None else None
    return closed if slopes is None else np.where(closed != 0.0, closed, slopes[: len(values)])


def is_viscous(parameter: Parameter) -> bool:
    """Whether a parameter is a viscosity or a damping, which a delay looks like."""
    return parameter.role == "viscous" or parameter.unit == "Pa*s"


def timing_uncertainty(settings: AlignmentSettings) -> float | None:
    """Standard uncertainty [s] of the time between force and motion; None where neither side declares any."""
    motion = settings.velocity or settings.position
    if settings.force.uncertainty is None and motion.uncertainty is None:
        return None
    return math.hypot(settings.force.uncertainty or 0.0, motion.uncertainty or 0.0)
