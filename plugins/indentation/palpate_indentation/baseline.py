"""The baseline that the air determines: tilted where it can, level where the press could be taken for a tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError

from palpate_indentation.approach_fit import CurveFit, correlation_time, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_MIN_AIR = 0.01  # of the travel, a choice: a surface that is nearer to the top leaves no air
_MIN_AIR_SAMPLES = 10  # a choice: the scatter about a line through fewer shows nothing
_MAX_TILT_FORCE = 0.1  # of the press's force (0185): up to there a tilt, or its uncertainty, is accepted
_MAX_EXTRAPOLATION = 4.0  # lengths of the air (0185): a large tilt is trusted for a press up to so deep
_MIN_BIC_DIFFERENCE = 10.0  # very strong evidence (Kass and Raftery 1995), for a tilt that is a large part of the force


@dataclass(frozen=True)
class BaselineFit:
    """The fit of a press, with the tilt that its air determines."""

    fit: CurveFit
    undetermined: CurveFit | None  # fit with a tilt that the air does not determine; None if it does, or none is fitted

    @property
    def by_tilt(self) -> float:
        """Standard uncertainty [unit of the modulus] by a tilt that is held at zero.

        It is the shift of the modulus by the tilt of least squares, at least what that tilt adds to the uncertainty of
        the modulus, and at most the modulus.
        """
        if self.undetermined is None:
            return 0.0
        added_std = np.sqrt(max(self.undetermined.modulus_std**2 - self.fit.modulus_std**2, 0.0))
        shift = abs(self.undetermined.modulus - self.fit.modulus)
        return float(min(max(shift, added_std), self.fit.modulus))


def fit_press(law: ElasticLaw, branch: Branch, noise: float, name: str, *, tilt: bool, robust: bool) -> BaselineFit:
    """Return the fit with the baseline that the air determines; raises LogError where nothing fits, or without air."""
    level = fit_curve(law, branch, noise, tilt=False, robust=robust)
    tilted = fit_curve(law, branch, noise, tilt=True, robust=robust) if tilt else None
    sound_tilted = tilted if tilted is not None and _is_sound(tilted) else None
    has_air = sound_tilted is not None and _begins_in_air(sound_tilted, branch)
    if sound_tilted is not None and has_air and _is_tilt_determined(law, branch, sound_tilted, level):
        return BaselineFit(sound_tilted, None)
    if not _is_sound(level):
        raise LogError(f"{name}: no modulus above 0 explains the force")
    if not _begins_in_air(level, branch):
        bent = ", or its force bends less than the model's" if sound_tilted is not None else ""
        raise LogError(f"{name}: the record begins in contact{bent}: without air no contact point can be found")
    return BaselineFit(level, tilted)


def force_of(law: ElasticLaw, branch: Branch, fit: CurveFit) -> float:
    """Return the largest force [N] that the modulus makes."""
    return float(np.max(np.abs(fit.modulus * law.geometry(fit.surface - branch.height))))


def _is_sound(fit: CurveFit) -> bool:
    return bool(np.isfinite([fit.modulus, fit.modulus_std, fit.surface]).all()) and fit.modulus > 0


def _begins_in_air(fit: CurveFit, branch: Branch) -> bool:
    return fit.surface <= float(branch.height.max() - _MIN_AIR * np.ptp(branch.height))


def _is_tilt_determined(law: ElasticLaw, branch: Branch, tilted: CurveFit, level: CurveFit) -> bool:
    """Return True if air determines the tilt to 10 % of the force, and a tilt beyond that without doubt.

    A press that hardly bends looks like a tilt: so only the air may determine it, and a tilt that is much of the
    force needs air over a fourth of the depth at least, and evidence that the press does not follow a level baseline.
    """
    depth = float(tilted.surface - branch.height.min())
    is_air = branch.height > tilted.surface
    tilt_limit = _MAX_TILT_FORCE * force_of(law, branch, tilted) / depth  # [N/m]
    if max(_line_tilt_std(branch.height[is_air], branch.force[is_air]), tilted.tilt_std) > tilt_limit:
        return False
    # A larger tilt: the air over a fourth of the depth, and 10 of BIC against a level baseline.
    if abs(tilted.tilt) <= tilt_limit:
        return True
    air_length = float(np.ptp(branch.height[is_air]))
    bic_difference = tilted.effective * 2.0 * np.log(level.rms / tilted.rms)
    return bool(_MAX_EXTRAPOLATION * air_length >= depth and bic_difference > _MIN_BIC_DIFFERENCE)


def _line_tilt_std(height: Floats, force: Floats) -> float:
    """Return the standard uncertainty [N/m] of the slope of a line through air (n,); infinite without air."""
    centred = height - height.mean() if len(height) else height
    if len(height) < _MIN_AIR_SAMPLES or not np.any(centred):
        return float("inf")
    residual = force - force.mean() - centred * float(centred @ force) / float(centred @ centred)
    variance = correlation_time(residual) * float(residual @ residual) / (len(residual) - 2)
    return float(np.sqrt(variance / (centred @ centred)))
