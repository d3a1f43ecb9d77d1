"""The baseline that the air determines: tilted where it can, level where the press could be taken for a tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError

from palpate_indentation.approach_fit import CurveFit, correlation_time, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_TOP = 0.01  # of the way
_LEAST_AIR = 10  # samples of air that a line is laid through
_MATTERS = 0.1  # of the press's force: what a baseline, or its uncertainty, is looked at from
_FURTHER = 4.0  # times its length to which a line through air is continued
_DECISIVE = 10.0  # of BIC, by which a tilt that is a large part of the force must explain the press better than none


@dataclass(frozen=True)
class BaselineFit:
    """The fit of a press, with the tilt that its air determines."""

    fit: CurveFit
    untold: CurveFit | None  # with a tilt that the air does not determine; None where it does, or if not requested

    @property
    def by_tilt(self) -> float:
        """Standard uncertainty [unit of the modulus] by a tilt that is held at zero.

        How far the tilt that least squares would choose moves the modulus, at least what its own uncertainty adds; at
        most all of the modulus.
        """
        if self.untold is None:
            return 0.0
        added = np.sqrt(max(self.untold.modulus_std**2 - self.fit.modulus_std**2, 0.0))
        return float(min(max(abs(self.untold.modulus - self.fit.modulus), added), self.fit.modulus))


def fit_press(law: ElasticLaw, branch: Branch, noise: float, name: str, *, tilt: bool, robust: bool) -> BaselineFit:
    """Return the fit with the baseline that the air determines; raises LogError where nothing fits, or without air."""
    level = fit_curve(law, branch, noise, tilt=False, robust=robust)
    tilted = fit_curve(law, branch, noise, tilt=True, robust=robust) if tilt else None
    if tilted is not None and _sound(tilted) and _begins_in_air(tilted, branch) and _told(law, branch, tilted, level):
        return BaselineFit(tilted, None)
    if not _sound(level):
        raise LogError(f"{name}: no modulus above 0 explains the force")
    if not _begins_in_air(level, branch):
        bent = ", or its force bends less than the model's" if tilted is not None and _sound(tilted) else ""
        raise LogError(f"{name}: the record begins in contact{bent}: without air no contact point can be found")
    return BaselineFit(level, tilted)


def force_of(law: ElasticLaw, branch: Branch, fit: CurveFit) -> float:
    """Return the largest force [N] that the modulus makes."""
    return float(np.max(np.abs(fit.modulus * law.geometry(fit.surface - branch.height))))


def _sound(fit: CurveFit) -> bool:
    return bool(np.isfinite([fit.modulus, fit.modulus_std, fit.surface]).all()) and fit.modulus > 0


def _begins_in_air(fit: CurveFit, branch: Branch) -> bool:
    return fit.surface <= float(branch.height.max() - _TOP * np.ptp(branch.height))


def _told(law: ElasticLaw, branch: Branch, fit: CurveFit, level: CurveFit) -> bool:
    """Whether the tilt is known beyond 10 % of the force from the air, and beyond doubt where it is larger than that.

    A press that hardly bends looks like a tilt: so only the air may determine it, and a tilt that is much of the
    force needs air over a fourth of the depth at least, and evidence that the press does not follow a level baseline.
    """
    depth, air = float(fit.surface - branch.height.min()), branch.height > fit.surface
    limit = _MATTERS * force_of(law, branch, fit) / depth
    by_air = _tilt_std(branch.height[air], branch.force[air])
    if max(by_air, fit.tilt_std) > limit:
        return False
    long = _FURTHER * float(np.ptp(branch.height[air])) >= depth
    return abs(fit.tilt) <= limit or (long and fit.effective * 2.0 * np.log(level.rms / fit.rms) > _DECISIVE)


def _tilt_std(height: Floats, force: Floats) -> float:
    """Standard uncertainty [N/m] of the slope of a line through air; infinite without air."""
    away = height - height.mean() if len(height) else height
    if len(height) < _LEAST_AIR or not np.any(away):
        return float("inf")
    left = force - force.mean() - away * float(away @ force) / float(away @ away)
    variance = correlation_time(left) * float(left @ left) / (len(left) - 2)
    return float(np.sqrt(variance / (away @ away)))
