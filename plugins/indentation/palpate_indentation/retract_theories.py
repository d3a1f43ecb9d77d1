"""Adhesion on the way out: the largest pull, and the fits of theories to the part that is still in contact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ContactModel, Floats
from palpate_kit.numerics.normal_equations import standard_errors

from palpate_indentation.adhesion import PULL_OF_THEORY, installed_theories
from palpate_indentation.approach_fit import CurveFit, correlation_time
from palpate_indentation.press import Branch

# The pull on the way out: choices.
_PULL_SIGMAS = 6.0  # of the noise, that a pull exceeds
_PULL_SCATTERS = 3.0  # standard deviations of the air behind, which also has slow changes
_MIN_PULL_SHARE = 0.01  # of the largest force
_MIN_PULL_READINGS = 5  # outliers are fewer
_AIR_SHARE = 20  # the last twentieth of the way out is air
_MIN_AIR_SAMPLES = 10
_DEEPEST_READINGS = 3  # whose median is the pull: one outlier does not count

# The fit of a theory to the way out: choices.
_MAX_READINGS = 1500
_STILL_HELD = 0.5  # of the pull: the tip comes off after the last reading with more
_LOW = (-7.0, -4.0, -3.0, -1.0)  # bounds of the scaled unknowns of `_RetractProblem`
_HIGH = (7.0, 4.0, 3.0, 1.0)
_MAX_START_SURFACE = 2.9  # travels: within its upper bound
_MIN_MARGIN = 1e-9  # of a start, to its bounds
_START_SURFACES = np.linspace(-0.3, 0.15, 19)  # travels, about the height of the largest pull
_START_MODULI = (-1.4, -0.7, 0.0, 0.7, 1.4)  # logarithm over the modulus of the way in: up to 4 times
_REFINED_STARTS = 4  # the best ones
_MIN_FREEDOM = 0.1  # of the readings: fewer degrees of freedom would make the variance arbitrary


@dataclass(frozen=True)
class PullOff:
    """The largest pull on the way out."""

    force: float  # [N] below the baseline
    std: float  # [N]


@dataclass(frozen=True)
class Theory:
    """A fit of a theory of adhesion to the way out."""

    name: str
    modulus: float  # [Pa]
    modulus_std: float
    work: float  # [J/m^2]
    work_std: float
    surface: float  # [m]
    rms: float  # [N]


def pull_off(retract: Branch, noise: float) -> PullOff | None:
    """Return the pull of a way out; None if none exceeds the noise [N], or without air behind to compare it with."""
    air_force = _air_force(retract)
    level, scatter = float(np.median(air_force)), max(float(air_force.std(ddof=1)), noise)
    pull = level - retract.force
    max_force = float(np.max(retract.force) - level)
    # 6 sigma of the noise, 3 of the scatter in the air, and 1 % of the largest force.
    limit = max(_PULL_SIGMAS * noise, _PULL_SCATTERS * scatter, _MIN_PULL_SHARE * max_force)
    if np.count_nonzero(pull > limit) < _MIN_PULL_READINGS:
        return None
    deepest = np.sort(pull)[-_DEEPEST_READINGS:]
    level_std = scatter / np.sqrt(len(air_force))
    return PullOff(float(np.median(deepest)), float(np.hypot(noise, level_std)))


def _air_force(retract: Branch) -> Floats:
    """Return the force (m,) [N] in the air behind a way out."""
    return retract.force[-max(len(retract) // _AIR_SHARE, _MIN_AIR_SAMPLES) :]


def theories(retract: Branch, approach: CurveFit, pull: PullOff, radius: float, poisson: float) -> Iterator[Theory]:
    """Yield the theories that are installed, each fitted to the way out: modulus, work, surface and offset."""
    for name, model in installed_theories(radius, poisson).items():
        problem = _retract_problem(
            model, retract, approach, pull, start_work=pull.force / (PULL_OF_THEORY[name] * radius)
        )
        yield _fitted_theory(name, problem)


@dataclass(frozen=True)
class _RetractProblem:
    """Least squares of a theory over a way out: the part that is still in contact, and the air behind for the offset.

    Scaled unknowns x (4,): logarithms of modulus and work over their start values, the surface from that of the way in,
    in travels, and the offset over the range of the force.
    """

    model: ContactModel
    approach: CurveFit
    height: Floats  # (n,) [m] in contact
    force: Floats  # (n,) [N]
    air_force: Floats  # (m,) [N]
    level: float  # [N] of the air
    force_range: float  # [N]
    travel: float  # [m]
    start_work: float  # [J/m^2]

    def theta(self, x: Floats) -> list[float]:
        """Return modulus [Pa] and work of adhesion [J/m^2]."""
        return [self.approach.modulus * float(np.exp(x[0])), self.start_work * float(np.exp(x[1]))]

    def surface(self, shift: Any) -> Any:
        """Return the height [m] of a surface that is shifted by so many travels from that of the way in."""
        return self.approach.surface + self.travel * shift

    def residual(self, x: Floats) -> Floats:
        """Return the residuals (n + m,) in units of the range of the force."""
        theta = self.theta(x)
        depth = np.maximum(self.surface(x[2]) - self.height, float(self.model.pull_off_depth(theta)))
        expected = np.asarray(self.model.force(depth, 0.0 * depth, theta), float)
        offset = self.force_range * x[3]
        in_contact = self.force - self.level - offset - expected
        return np.concatenate([in_contact, self.air_force - self.level - offset]) / self.force_range


def _retract_problem(
    model: ContactModel, retract: Branch, approach: CurveFit, pull: PullOff, start_work: float
) -> _RetractProblem:
    """Return the problem of a theory with at most some 1500 readings in contact, and as dense ones of the air.

    The tip comes off where the record shows it; a force that jumps there would leave least squares without a slope.
    """
    air_force = _air_force(retract)
    level = float(np.median(air_force))
    last_held = int(np.flatnonzero(level - retract.force > _STILL_HELD * pull.force)[-1])
    stride = max((last_held + 1) // _MAX_READINGS, 1)
    height = retract.height[: last_held + 1 : stride]
    return _RetractProblem(
        model,
        approach,
        height,
        force=retract.force[: last_held + 1 : stride],
        air_force=air_force[:: max(len(air_force) * stride // len(retract), 1)],
        level=level,
        force_range=float(np.ptp(retract.force)),
        travel=float(np.ptp(height)),
        start_work=start_work,
    )


def _starts(problem: _RetractProblem, low: Floats, high: Floats) -> list[Floats]:
    """Return the start values (4,) of a problem within bounds (4,), the best first: a grid of surfaces and moduli."""
    pull_height = float(problem.height[np.argmin(problem.force)])
    pull_shift = (pull_height - problem.approach.surface) / problem.travel
    starts = [
        np.clip([log_modulus, 0.0, pull_shift + shift, 0.0], low + _MIN_MARGIN, high - _MIN_MARGIN)
        for shift in _START_SURFACES.tolist()
        for log_modulus in _START_MODULI
    ]
    return sorted(starts, key=lambda x: float(np.sum(problem.residual(x) ** 2)))


def _fitted_theory(name: str, problem: _RetractProblem) -> Theory:
    """Return a theory by the least squares of its problem; uncertainties count the correlation of residuals."""
    from scipy.optimize import least_squares

    low, high = np.array(_LOW), np.array(_HIGH)
    if not problem.model.pull_off_depth([1.0, 1.0]):
        # Contact ends at depth 0 by this theory, so that all readings in contact are below the surface.
        lowest_surface = (float(problem.height.max()) - problem.approach.surface) / problem.travel
        low[2] = min(lowest_surface, _MAX_START_SURFACE)
    starts = _starts(problem, low, high)[:_REFINED_STARTS]
    solutions = [least_squares(problem.residual, x, bounds=(low, high), x_scale="jac") for x in starts]
    best = min(solutions, key=lambda solution: float(solution.cost))

    x, residual = best.x, problem.residual(best.x)
    correlation = correlation_time(residual)
    freedom = max(len(residual) - len(x) * correlation, _MIN_FREEDOM * len(residual))
    variance = float(residual @ residual) / freedom
    std = standard_errors(np.asarray(best.jac)) * np.sqrt(variance * correlation)
    # A standard uncertainty of a logarithm is a relative one.
    modulus, work = problem.theta(x)
    return Theory(
        name,
        modulus,
        modulus * float(std[0]),
        work,
        work * float(std[1]),
        surface=problem.surface(float(x[2])),
        rms=problem.force_range * float(np.sqrt(np.mean(residual**2))),
    )
