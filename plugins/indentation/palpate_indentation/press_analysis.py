"""All that is found of one press, and as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Flag, Floats, LogError
from palpate.host import finite_tree

from palpate_indentation.adhesion import PullOff, Theory, pull_off, tabor, theories
from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.baseline import BaselineFit, fit_press, force_of
from palpate_indentation.contact_points import ContactPointResult, contact_points, spread
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.modulus_over_depth import ModulusProfile, change_over_depth, secant_profile, tangent_profile
from palpate_indentation.press import Branch, Press
from palpate_indentation.sphere_laws import SphereLawFit, sphere_laws, sphere_radius

_SURE = 3.0  # standard uncertainties
_MATTERS = 0.05  # of the modulus
_LARGE = 0.5  # of the force


@dataclass(frozen=True)
class PressSettings:
    """How a press is looked at."""

    tilt: bool = True
    robust: bool = False
    bins: int = 40
    windows: int = 8
    retract: bool = False  # fit the way out in place of the way in


@dataclass(frozen=True)
class Indentation:
    """What one press says."""

    law: ElasticLaw
    press: Press
    branch: Branch  # that was fitted
    fitted: BaselineFit
    points: Mapping[str, ContactPointResult]
    surface_spread: float  # [m]
    by_contact: float  # [unit of the modulus] by the spread of the contact point
    secant: ModulusProfile
    tangent: ModulusProfile
    rise: tuple[float, float]  # relative change from the shallower to the deeper half, and its uncertainty
    spheres: tuple[SphereLawFit, ...]
    pull: PullOff | None
    theories: tuple[Theory, ...]
    radius: float | None  # [m] of a sphere
    flags: tuple[Flag, ...]

    @property
    def fit(self) -> CurveFit:
        """What least squares finds."""
        return self.fitted.fit

    @property
    def combined(self) -> float:
        """Standard uncertainty of the modulus: of the fit, of the methods' spread, and of a tilt that is not told."""
        return float(np.linalg.norm([self.fit.modulus_std, self.by_contact, self.fitted.by_tilt]))

    @property
    def depth(self) -> float:
        """Deepest depth [m]."""
        return float((self.fit.surface - self.branch.height).max())


def analyse_press(law: ElasticLaw, press: Press, settings: PressSettings, name: str = "record") -> Indentation:
    """Everything of a press; raises LogError where nothing fits."""
    branch = press.approach
    if settings.retract:
        if press.retract is None:
            raise LogError(f"{name}: there is no way out to fit")
        branch = press.retract
    fitted = fit_press(law, branch, press.noise, name, tilt=settings.tilt, robust=settings.robust)
    fit, tilt = fitted.fit, settings.tilt and fitted.untold is None
    points = contact_points(press, fit)
    apart = spread(points)
    moved = [
        fit_curve(law, branch, press.noise, tilt=tilt, robust=settings.robust, surface=fit.surface + side * apart)
        for side in ((1, -1) if apart > 0 else ())
    ]
    by_contact = 0.5 * abs(moved[0].modulus - moved[1].modulus) if moved else 0.0
    radius = sphere_radius(law.model)
    pull = pull_off(press.retract, press.noise) if press.retract is not None else None
    poisson = float(getattr(law.model, "poisson", 0.5))
    sticking: tuple[Theory, ...] = ()
    if pull is not None and radius is not None and press.retract is not None:
        sticking = tuple(theories(press.retract, fit, pull, radius, poisson))
    rise = change_over_depth(law, branch, fit, float(np.hypot(fit.surface_std, apart)))
    return Indentation(
        law, press, branch, fitted, points, apart, by_contact,
        secant_profile(law, branch, fit, float(np.hypot(fit.surface_std, apart)), settings.bins),
        tangent_profile(law, branch, fit, float(np.hypot(fit.surface_std, apart)), settings.windows),
        rise, tuple(sphere_laws(law, branch, press.noise, tilt=tilt, robust=settings.robust)),
        pull, sticking, radius, tuple(_flags(law, branch, fitted, by_contact, rise, pull)),
    )  # fmt: skip


def _flags(
    law: ElasticLaw,
    branch: Branch,
    fitted: BaselineFit,
    by_contact: float,
    rise: tuple[float, float],
    pull: PullOff | None,
) -> list[Flag]:
    found, fit = [], fitted.fit
    if abs(rise[0]) > max(_SURE * rise[1], _MATTERS):
        what = (
            f"the modulus changes by {rise[0]:+.0%} +- {rise[1]:.1%} from the shallower half of the depth to the deeper"
        )
        found.append(Flag("modulus-over-depth", what))
    if by_contact > _MATTERS * fit.modulus:
        what = f"the spread of the contact point moves the modulus by {by_contact / fit.modulus:.0%}"
        found.append(Flag("contact-point-unclear", what))
    if pull is not None:
        found.append(Flag("adhesion", f"the material pulls with {pull.force:.3g} +- {pull.std:.2g} N"))
    if fit.tilt_std > 0 and abs(fit.tilt) > 2 * _SURE * fit.tilt_std:
        found.append(Flag("tilted-baseline", f"{fit.tilt:+.3g} +- {fit.tilt_std:.2g} N/m over the height"))
    return found + _of_baseline(law, branch, fitted)


def _of_baseline(law: ElasticLaw, branch: Branch, fitted: BaselineFit) -> list[Flag]:
    fit, other = fitted.fit, fitted.untold
    if other is not None and fitted.by_tilt > _MATTERS * fit.modulus:
        what = (
            f"the air does not tell the tilt ({other.tilt:+.3g} +- {other.tilt_std:.2g} N/m by least squares): held at "
            f"zero, which counts {fitted.by_tilt / fit.modulus:.0%} in the uncertainty of the modulus"
        )
        return [Flag("baseline-unclear", what)]
    taken = abs(fit.tilt) * float(fit.surface - branch.height.min()) / force_of(law, branch, fit)
    if taken > _LARGE:
        what = f"the tilt of the baseline makes {taken:.0%} of the press's force over its depth"
        return [Flag("baseline-unclear", what)]
    return []


def table(found: Indentation) -> dict[str, Any]:
    """As in ``indentation.json`` [SI]."""
    fit = found.fit
    document: dict[str, Any] = {
        "parameter": found.law.name,
        "unit": found.law.unit,
        "value": fit.modulus,
        "std": fit.modulus_std,
        "contact_point": found.by_contact,
        "combined": found.combined,
        "surface": {"value": fit.surface, "std": fit.surface_std, "spread": found.surface_spread},
        "baseline": {"offset": fit.offset, "tilt": fit.tilt, "tilt_std": fit.tilt_std, "by_tilt": found.fitted.by_tilt},
        "rms": fit.rms,
        "noise": found.press.noise,
        "correlation_time": fit.correlation_time,
        "depth": found.depth,
        "rise_over_depth": {"value": found.rise[0], "std": found.rise[1]},
        "contact_points": {
            name: {"surface": p.surface, "std": p.std, "by_the_fit": p.usual} for name, p in found.points.items()
        },
        "spheres": {one.tip: _alternative(one, found) for one in found.spheres},
        "pull_off": None if found.pull is None else {"force": found.pull.force, "std": found.pull.std},
        "adhesion": {one.name: _theory(one, found) for one in found.theories},
        "secant": _profile(found.secant),
        "tangent": _profile(found.tangent),
        "flags": [{"code": flag.code, "message": flag.message} for flag in found.flags],
    }
    plain: dict[str, Any] = finite_tree(document)
    return plain


def bic_above_best(one: SphereLawFit, found: Indentation) -> float:
    """By the samples that count at the best: all laws have the same number of unknowns."""
    best = min(found.spheres, key=lambda other: other.fit.rms).fit
    return best.effective * 2.0 * float(np.log(one.fit.rms / best.rms))


def _alternative(one: SphereLawFit, found: Indentation) -> dict[str, Any]:
    return {
        "value": one.fit.modulus,
        "std": one.fit.modulus_std,
        "surface": one.fit.surface,
        "rms": one.fit.rms,
        "bic_above_best": bic_above_best(one, found),
        "chosen": one.chosen,
    }


def _theory(one: Theory, found: Indentation) -> dict[str, Any]:
    assert found.radius is not None
    poisson = float(getattr(found.law.model, "poisson", 0.5))
    return {
        "value": one.modulus,
        "std": one.modulus_std,
        "adhesion_work": one.work,
        "adhesion_work_std": one.work_std,
        "surface": one.surface,
        "rms": one.rms,
        "tabor": tabor(found.radius, one.work, one.modulus, poisson),
    }


def _profile(profile: ModulusProfile) -> dict[str, Floats]:
    return {
        "begin": profile.begin,
        "end": profile.end,
        "value": profile.modulus,
        "noise": profile.noise,
        "contact_point": profile.contact,
        "combined": profile.std,
    }
