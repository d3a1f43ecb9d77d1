"""Running-in: from when on a record is one steady contact, and what its values are there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from palpate import ContactModel
from palpate_engine import display_unit

from palpate_uncertainty.model_alternatives import Refit, refit
from palpate_uncertainty.refit import Course
from palpate_uncertainty.whiteness import WhitenessTest

_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)  # of the record, that may be left out at its beginning
_ENOUGH = 300  # samples


@dataclass(frozen=True)
class SteadyPart:
    """The rest of a record, over which its residual changes no more with time."""

    begin: float  # [s] after the first sample
    fit: Refit

    def sentence(self, model: ContactModel) -> str:
        """From when on, and the values there."""
        values = []
        for parameter, value in zip(model.parameters, self.fit.theta.tolist(), strict=True):
            unit, scale = display_unit(parameter.unit)
            values.append(f"{parameter.name} {scale * value:.4g} {unit}")
        return f"steady from {self.begin:.1f} s of contact on, where it finds {', '.join(values)}"


def steady_part(
    course: Course, fit: Refit, test: Callable[[Course, Refit], WhitenessTest], level: float
) -> SteadyPart | None:
    """The longest rest of the record, of at least half of it, that a model fitted to it leaves steady in time.

    `test` are the tests of what a fit to a course leaves; the one over time must be above a `level`. None where no rest
    is.
    """
    times = course.time[course.used]
    for share in _SHARES if len(times) else ():
        begin = float(times[0]) + share * float(times[-1] - times[0])
        rest = replace(course, used=course.used & (course.time >= begin))
        if np.count_nonzero(rest.used) < _ENOUGH:
            return None
        local = refit(rest, fit.theta, fit.surface)
        if test(rest, local).tests.get("time", 1.0) >= level:
            return SteadyPart(begin - float(times[0]), local)
    return None
