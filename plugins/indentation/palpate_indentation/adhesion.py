"""Adhesion: the theory that explains a way in, the pull on the way out, and what theories conclude from that."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import ContactModel, Floats
from palpate_engine import registry as registries
from palpate_kit.numerics.normal_equations import standard_errors

from palpate_indentation.approach_fit import CurveFit, correlation_time, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.sphere_laws import sphere_radius

THEORIES = {"dmt": 2.0 * np.pi, "jkr": 1.5 * np.pi}  # largest pull over w R, by the name of the model
_SIGMAS = 6.0  # of the noise, that the pull passes
_SHARE = 0.01  # of the largest force, that it passes
_IN_ALL = 5  # readings beyond
_SAMPLES = 1500
_HANGS_TOGETHER = 1.5  # samples, over which a residual is more than noise
_SURE = 3.0  # standard uncertainties
_DECISIVE = 10.0  # of BIC
_RANGE = 3e-10  # [m] of the attraction between surfaces, in Tabor's parameter


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


@dataclass(frozen=True)
class StickingLaw:
    """The theory of adhesion that explains a way in, and its fit."""

    law: ElasticLaw
    fit: CurveFit
    apart: float  # [Pa] by how much the modulus of another theory differs that explains it as well; 0: none does


def law_that_sticks(
    law: ElasticLaw, branch: Branch, noise: float, plain: CurveFit, *, tilt: bool
) -> StickingLaw | None:
    """Return the theory of a sphere that explains a way in better than the law without adhesion; None where none does.

    Sought only where the residual of the `plain` fit hangs together, so that something is not in its law.
    """
    radius, poisson = sphere_radius(law.model), float(getattr(law.model, "poisson", 0.5))
    if radius is None or law.unit != "Pa" or plain.correlation_time < _HANGS_TOGETHER:
        return None
    pull = noise / (1.5 * np.pi * radius * plain.modulus)
    top = float(plain.modulus * law.geometry(plain.surface - branch.height).max()) / noise
    found = []
    for model in _theories(radius, poisson).values():
        own = ElasticLaw(model, law.name, law.unit, 0, (0.0, 0.0), adhesion=pull * np.sqrt(max(top, 1.0)))
        fit = fit_curve(own, branch, noise, tilt=tilt)
        if np.isfinite([fit.modulus, fit.modulus_std]).all() and fit.work > _SURE * fit.work_std:
            found.append(StickingLaw(replace(own, adhesion=fit.work / fit.modulus), fit, 0.0))
    if not found:
        return None
    best, *others = sorted(found, key=lambda one: one.fit.rms)
    if not best.fit.bic_above(plain, 1) < -_DECISIVE:
        return None
    apart = [one.fit.modulus - best.fit.modulus for one in others if one.fit.bic_above(best.fit, 0) < _DECISIVE]
    return replace(best, apart=float(np.max(np.abs(apart), initial=0.0)))


def pull_off(retract: Branch, noise: float) -> PullOff | None:
    """Return the pull of a way out; None if none exceeds the noise, or without air behind to compare it with."""
    count = len(retract)
    air = retract.force[-max(count // 20, 10) :]
    level, scatter = float(np.median(air)), max(float(air.std(ddof=1)), noise)
    pull = level - retract.force
    limit = max(_SIGMAS * noise, 3.0 * scatter, _SHARE * float(np.max(retract.force) - level))
    if np.count_nonzero(pull > limit) < _IN_ALL:
        return None
    deepest = np.sort(pull)[-3:]
    return PullOff(float(np.median(deepest)), float(np.hypot(noise, scatter / np.sqrt(len(air)))))


def theories(retract: Branch, approach: CurveFit, pull: PullOff, radius: float, poisson: float) -> Iterator[Theory]:
    """Yield the theories that are installed, each fitted to the way out: modulus, work, surface and offset."""
    for name, model in _theories(radius, poisson).items():
        yield _fitted(name, model, retract, approach, pull, THEORIES[name] * radius)


def _theories(radius: float, poisson: float) -> dict[str, Any]:
    """Return the theories that are installed, by name."""
    parts = registries.load().parts["model"]
    settings = {"radius": radius, "poisson": poisson}
    return {name: parts[name].part.model_validate(settings) for name in THEORIES if name in parts}


def tabor(radius: float, work: float, modulus: float, poisson: float) -> float:
    """(R w^2/(E*^2 z0^3))^(1/3): above 5 the contact is JKR's, below 0.1 DMT's (Tabor 1977)."""
    plane = modulus / (1.0 - poisson**2)
    return float((radius * work**2 / (plane**2 * _RANGE**3)) ** (1 / 3))


def _fitted(name: str, model: ContactModel, branch: Branch, start: CurveFit, pull: PullOff, factor: float) -> Theory:
    """Least squares over what is still in contact, and the air behind for the offset.

    Where the tip comes off is seen in the record; a force that jumps there would leave least squares without a slope.
    """
    from scipy.optimize import least_squares

    count = len(branch)
    air = branch.force[-max(count // 20, 10) :]
    level = float(np.median(air))
    held = int(np.flatnonzero(level - branch.force > 0.5 * pull.force)[-1]) + 1
    step = max(held // _SAMPLES, 1)
    height, force = branch.height[:held:step], branch.force[:held:step]
    top, reach, work = float(np.ptp(branch.force)), float(np.ptp(height)), pull.force / factor
    behind = air[:: max(len(air) * step // count, 1)]

    def theta(x: Floats) -> list[float]:
        return [start.modulus * float(np.exp(x[0])), work * float(np.exp(x[1]))]

    def left(x: Floats) -> Floats:
        values = theta(x)
        depth = np.maximum(start.surface + reach * x[2] - height, float(model.pull_off_depth(values)))
        expected = np.asarray(model.force(depth, 0.0 * depth, values), float)
        return np.concatenate([force - level - top * x[3] - expected, behind - level - top * x[3]]) / top

    low, high = [-7.0, -4.0, -3.0, -1.0], [7.0, 4.0, 3.0, 1.0]
    if not model.pull_off_depth([1.0, 1.0]):  # no contact above the surface: all of what is held lies below it
        low[2] = min((float(height.max()) - start.surface) / reach, 2.9)
    pulled = (float(height[np.argmin(force)]) - start.surface) / reach
    starts = sorted(
        (
            np.clip([modulus, 0.0, pulled + surface, 0.0], np.array(low) + 1e-9, np.array(high) - 1e-9)
            for surface in np.linspace(-0.3, 0.15, 19).tolist()
            for modulus in (-1.4, -0.7, 0.0, 0.7, 1.4)
        ),
        key=lambda x: float(np.sum(left(x) ** 2)),
    )
    solutions = [least_squares(left, x, bounds=(low, high), x_scale="jac") for x in starts[:4]]
    best = min(solutions, key=lambda found: float(found.cost))
    x, residual, jacobian = best.x, left(best.x), np.asarray(best.jac)
    time = correlation_time(residual)
    variance = float(residual @ residual) / max(len(residual) - 4 * time, 0.1 * len(residual))
    std = standard_errors(jacobian) * np.sqrt(variance * time)
    modulus, energy = theta(x)
    rms = top * float(np.sqrt(np.mean(residual**2)))
    surface = start.surface + reach * float(x[2])
    return Theory(name, modulus, modulus * float(std[0]), energy, energy * float(std[1]), surface, rms)
