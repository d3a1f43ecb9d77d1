"""Laws of a material that may explain a record: sums of the forces of units along its motion."""

from __future__ import annotations

import numpy as np
from palpate import Floats

from palpate_uncertainty.delay.timed_record import Columns, ResponseLaw, TimedRecord
from palpate_uncertainty.refit import Course
from palpate_uncertainty.relaxation_alternatives import relaxing_share

# Choices: they trade the time of a fit for the range of materials that a law describes.
# They apply to a delay that nobody has stated, in a motion of several lines and over 1000 samples.
_TIMES_PER_DECADE = 4  # of the branches that make up a power law
_TIME_MARGIN = 10.0  # by which these branches go beyond the step and the span of a record
# A branch with more time constants than this in the span has forgotten what was before the record.
_FORGETTING_TIMES = 1000.0  # time constants in a record
# Choices: exponents of a power law, from which a fit begins and between which it stays; 0 is a spring, 1 a dashpot.
_EXPONENT, _EXPONENT_BOUNDS = 0.1, (0.005, 0.7)  # of a power law alone
_EXPONENT_OF_DAMPING, _DAMPING_BOUNDS = 0.3, (0.005, 0.95)  # of one in parallel with a spring, which may be a dashpot
_BRANCH_TIMES = (0.02, 0.3)  # [s] from which a fit begins: a choice, within the periods of a palpation


def kelvin_voigt() -> ResponseLaw:
    """Return the track's own law: an elastic and a viscous force."""
    return ResponseLaw("kelvin-voigt", lambda course, surface, nonlinear: unit_forces(course, surface))


def simple_laws(record: TimedRecord, elastic: int) -> list[ResponseLaw]:
    """Return Kelvin and Voigt's law, a power law of time (constant loss angle), and one branch that relaxes.

    `elastic` is the place of the elastic parameter among those of the model.
    """
    low, high = _EXPONENT_BOUNDS
    power_law = _power_law_columns(record, elastic, has_spring=False)
    return [
        kelvin_voigt(),
        ResponseLaw(name="power-law", columns=power_law, start=(_EXPONENT,), lower=(low,), upper=(high,)),
        _branch_law("one-branch", record, elastic, _BRANCH_TIMES[:1]),
    ]


def richer_laws(record: TimedRecord, elastic: int) -> list[ResponseLaw]:
    """Return the laws of a record that is not Kelvin and Voigt's: a spring and a power law, and two branches."""
    low, high = _DAMPING_BOUNDS
    fractional = _power_law_columns(record, elastic, has_spring=True)
    return [
        ResponseLaw(
            name="fractional-kelvin-voigt",
            columns=fractional,
            start=(_EXPONENT_OF_DAMPING,),
            lower=(low,),
            upper=(high,),
        ),
        _branch_law("two-branches", record, elastic, _BRANCH_TIMES),
    ]


def unit_forces(course: Course, surface: float) -> Floats:
    """Return the forces (n, 2) of one unit of each parameter; 0 out of contact."""
    is_touching = course.depth(surface) > 0
    forces = [course.forces(np.where(np.arange(2) == i, 1.0, 0.0), surface) for i in range(2)]
    return np.where(is_touching[:, None], np.nan_to_num(np.column_stack(forces)), 0.0)


def _power_law_columns(record: TimedRecord, elastic: int, has_spring: bool) -> Columns:
    """Return the columns of a modulus that fades by a power t^-a of time, with a spring in parallel or without one.

    The power is a sum of branches of the times t_i, four a decade, with the shares t_i^-a; a is the law's nonlinear
    parameter. `elastic` is the place of the elastic parameter among those of the model; the record has the interval
    of its samples, `step` [s].
    """
    shortest, longest = record.step / _TIME_MARGIN, _TIME_MARGIN * record.course.span
    times = 10.0 ** np.arange(np.log10(shortest), np.log10(longest), 1.0 / _TIMES_PER_DECADE)

    def columns(course: Course, surface: float, nonlinear: Floats) -> Floats:
        elastic_force = unit_forces(course, surface)[:, elastic]
        shares = times ** -float(nonlinear[0])
        branches = np.column_stack([relaxing_share(elastic_force, record.step / time) for time in times])
        fading = np.asarray(branches @ (shares / shares.sum()))
        past = _past_forces(course, times[::_TIMES_PER_DECADE])  # one a decade
        return np.column_stack([elastic_force, fading, past] if has_spring else [fading, past])

    return columns


def _branch_law(name: str, record: TimedRecord, elastic: int, times: tuple[float, ...]) -> ResponseLaw:
    """Return a spring in parallel with branches, whose nonlinear parameters are the logarithms of their times [s].

    `times` [s] are those from which a fit begins, `elastic` is the place of the model's elastic parameter.
    """

    def columns(course: Course, surface: float, nonlinear: Floats) -> Floats:
        elastic_force = unit_forces(course, surface)[:, elastic]
        branch_times = np.exp(nonlinear)
        branches = [relaxing_share(elastic_force, record.step / time) for time in branch_times.tolist()]
        return np.column_stack([elastic_force, *branches, _past_forces(course, branch_times)])

    # A record shows no branch that is faster than a sample or slower than all of it.
    shortest, longest = float(np.log(record.step)), float(np.log(record.course.span))
    start = tuple(float(np.log(time)) for time in times)
    return ResponseLaw(
        name=name, columns=columns, start=start, lower=(shortest,) * len(times), upper=(longest,) * len(times)
    )


def _past_forces(course: Course, times: Floats) -> Floats:
    """Return the forces (n, m) that had not faded when the record began, each of size 1; none if it began in air.

    Their sizes depend on the motion before the record, and are unknowns of the fit.
    """
    slow = times[times > course.span / _FORGETTING_TIMES] if not course.from_air else times[:0]
    return np.exp(-(course.time - course.begin)[:, None] / slow[None, :])
