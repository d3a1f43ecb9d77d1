"""All that is found of one press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import BudgetRow, Flag, LogError

from palpate_indentation.adhesion import PullOff, Theory, law_that_sticks, pull_off, theories
from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.baseline import BaselineFit, fit_press, force_of
from palpate_indentation.contact_points import ContactPointResult, contact_points
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.modulus_over_depth import ModulusProfile, change_over_depth, secant_profile, tangent_profile
from palpate_indentation.press import Branch, Press
from palpate_indentation.press_budget import Declared, bound_of_viscosity, declared_rows, modulus_row
from palpate_indentation.sphere_laws import SphereLawFit, sphere_laws, sphere_radius
from palpate_indentation.viscosity import PressViscosity, viscosity_of_press

_SURE = 3.0  # standard uncertainties
_MATTERS = 0.05  # of the modulus
_LARGE = 0.5
Doubt = tuple[str, float | None, str, float]  # source, standard uncertainty, unit, contribution to the modulus


@dataclass(frozen=True)
class PressSettings:
    """How a press is looked at."""

    tilt: bool = True
    robust: bool = False
    bins: int = 40
    windows: int = 8
    retract: bool = False  # fit the way out in place of the way in


def contributions(law: ElasticLaw, budget: Sequence[BudgetRow]) -> list[float]:
    """Of every row to the uncertainty of the modulus [unit of it]."""
    return [row.effects[law.name].contribution or 0.0 for row in budget]


@dataclass(frozen=True)
class Indentation:
    """What one press says."""

    law: ElasticLaw
    press: Press
    branch: Branch  # that was fitted
    fitted: BaselineFit
    points: Mapping[str, ContactPointResult]
    secant: ModulusProfile
    tangent: ModulusProfile
    rise: tuple[float, float]  # relative change from the shallower to the deeper half, and its uncertainty
    spheres: tuple[SphereLawFit, ...]
    pull: PullOff | None
    theories: tuple[Theory, ...]
    radius: float | None  # [m] of a sphere
    flags: tuple[Flag, ...]
    without: CurveFit | None  # by the pipeline's own law, where the way in shows adhesion and the law is that of it
    viscosity: PressViscosity | None  # None: the model has none, or none that the force is proportional to
    budget: tuple[BudgetRow, ...]  # of everything, beginning with the fit itself

    @property
    def fit(self) -> CurveFit:
        """What least squares finds."""
        return self.fitted.fit

    @property
    def combined(self) -> float:
        """Standard uncertainty of the modulus: the root of the sum of the budget's squares."""
        return float(np.linalg.norm(contributions(self.law, self.budget)))

    @property
    def depth(self) -> float:
        """Deepest depth [m]."""
        return float((self.fit.surface - self.branch.height).max())


def analyse_press(
    law: ElasticLaw,
    press: Press,
    settings: PressSettings,
    name: str = "record",
    *,
    viscosity: PressViscosity | None = None,
    declared: Declared | None = None,
) -> Indentation:
    """Everything of a press; raises LogError where nothing fits.

    The viscosity is the one that was stated, or else the one that is given, or else what the press itself shows.
    """
    branch = press.approach
    if settings.retract:
        if press.retract is None:
            raise LogError(f"{name}: no way out to fit")
        branch = press.retract
    viscosity = _viscosity(law, press, branch, settings, viscosity)
    if viscosity is not None:
        law = law.with_viscosity(viscosity.value)
    fitted = fit_press(law, branch, press.noise, name, tilt=settings.tilt, robust=settings.robust)
    fit, tilt = fitted.fit, settings.tilt and fitted.untold is None
    shapes = sphere_laws(law, branch, press.noise, viscosity, tilt=tilt, robust=settings.robust)
    radius = sphere_radius(law.model)
    law, fitted, doubts, without = _explained(law, press, branch, fitted, viscosity, settings)
    fit = fitted.fit
    rows: list[Doubt] = [("fit", None, "", fit.modulus_std), *(doubt for doubt in doubts if doubt[3])]
    budget = (
        *(modulus_row(*row, law, fit) for row in rows),
        *declared_rows(law, branch, fit, declared or Declared()),
    )
    pull = pull_off(press.retract, press.noise) if press.retract is not None else None
    poisson = float(getattr(law.model, "poisson", 0.5))
    found: tuple[Theory, ...] = ()
    if pull is not None and radius is not None and press.retract is not None:
        found = tuple(theories(press.retract, fit, pull, radius, poisson))
    rise = _rise(law, branch, fit, viscosity)
    return Indentation(
        law, press, branch, fitted, contact_points(press, fit),
        secant_profile(law, branch, fit, settings.bins), tangent_profile(law, branch, fit, settings.windows),
        rise, tuple(shapes), pull, found, radius, tuple(_flags(law, branch, fitted, budget, rise, pull)), without,
        viscosity, budget,
    )  # fmt: skip


def _explained(
    law: ElasticLaw,
    press: Press,
    branch: Branch,
    fitted: BaselineFit,
    viscosity: PressViscosity | None,
    settings: PressSettings,
) -> tuple[ElasticLaw, BaselineFit, list[Doubt], CurveFit | None]:
    """The law of a press with its fit and what it leaves open; and its own fit, where a theory of adhesion is the law.

    No theory has a viscosity, so that none is tried where it is known.
    """
    fit, known = fitted.fit, viscosity is not None and viscosity.source != "bound"
    sticking = None if settings.retract or known else law_that_sticks(law, branch, press.noise, fit, tilt=settings.tilt)
    if sticking is None:
        tilt = settings.tilt and fitted.untold is None
        of_viscosity = _of_viscosity(law, press, branch, fit, viscosity, tilt=tilt, robust=settings.robust)
        return law, fitted, [*of_viscosity, ("tilt", None, "", fitted.by_tilt)], None
    doubts: list[Doubt] = [("theory of adhesion", None, "", sticking.apart)]
    if viscosity is not None:
        bound, moved = bound_of_viscosity(sticking.law, law, branch, sticking.fit)
        doubts.append(("viscosity", bound, viscosity.unit, min(moved, sticking.fit.modulus)))
    return sticking.law, BaselineFit(sticking.fit, None), doubts, fit


def _viscosity(
    law: ElasticLaw, press: Press, branch: Branch, settings: PressSettings, given: PressViscosity | None
) -> PressViscosity | None:
    """What was stated; else what is known from elsewhere; else what the press itself shows or allows."""
    if law.viscosity is None:
        return None
    name, value, unit = law.viscosity
    if name in law.stated:
        return PressViscosity(value, 0.0, unit, "stated", "stated")
    return given if given is not None else viscosity_of_press(law, press, branch, tilt=settings.tilt)


def _of_viscosity(
    law: ElasticLaw, press: Press, branch: Branch, fit: CurveFit, viscosity: PressViscosity | None, **how: bool
) -> list[Doubt]:
    """How far the modulus moves with the viscosity, at most all of it: by fits, since it is hardly a first order.

    At one speed the viscous force has the shape of what a surface does that lies higher.
    """
    if viscosity is None or viscosity.std == 0:
        return []
    sides = (1.0,) if viscosity.value < viscosity.std else (1.0, -1.0)
    moved = [
        fit_curve(law.with_viscosity(viscosity.value + side * viscosity.std), branch, press.noise, **how).modulus
        for side in sides
    ]
    shifts = [abs(value - fit.modulus) if np.isfinite(value) else fit.modulus for value in moved]
    return [("viscosity", viscosity.std, viscosity.unit, min(float(np.mean(shifts)), fit.modulus))]


def _rise(law: ElasticLaw, branch: Branch, fit: CurveFit, viscosity: PressViscosity | None) -> tuple[float, float]:
    """Relative change of the modulus over depth, and its uncertainty with that of the viscosity."""
    value, std = change_over_depth(law, branch, fit)
    if law.viscous is None or viscosity is None or viscosity.std == 0:
        return value, std
    more = law.with_viscosity(viscosity.value + viscosity.std)
    return value, float(np.hypot(std, change_over_depth(more, branch, fit)[0] - value))


def _flags(
    law: ElasticLaw,
    branch: Branch,
    fitted: BaselineFit,
    budget: tuple[BudgetRow, ...],
    rise: tuple[float, float],
    pull: PullOff | None,
) -> list[Flag]:
    found, fit = [], fitted.fit
    if abs(rise[0]) > max(_SURE * rise[1], _MATTERS):
        what = (
            f"the modulus changes by {rise[0]:+.0%} +- {rise[1]:.1%} from the shallower half of the depth to the deeper"
        )
        found.append(Flag("modulus-over-depth", what, effects={law.name: 0.5 * abs(rise[0]) * fit.modulus}))
    shares = dict(zip((row.source for row in budget), contributions(law, budget), strict=True))
    own = shares.pop("viscosity", 0.0)
    if own > max(float(np.linalg.norm(list(shares.values()))), _MATTERS * fit.modulus):
        what = f"what is not known of the viscosity moves the modulus by {own / fit.modulus:.0%}, more than all else"
        found.append(Flag("viscosity-unclear", what, effects={law.name: own}, causes=("viscosity",)))
    if pull is not None:
        found.append(Flag("adhesion", f"the material pulls with {pull.force:.3g} +- {pull.std:.2g} N"))
    return found + _of_baseline(law, branch, fitted)


def _of_baseline(law: ElasticLaw, branch: Branch, fitted: BaselineFit) -> list[Flag]:
    fit, other = fitted.fit, fitted.untold
    if other is not None and fitted.by_tilt > _MATTERS * fit.modulus:
        what = (
            f"the air does not show the tilt ({other.tilt:+.3g} +- {other.tilt_std:.2g} N/m by least squares): held at "
            f"zero, which counts {fitted.by_tilt / fit.modulus:.0%} in the uncertainty of the modulus"
        )
        return [Flag("baseline-unclear", what, effects={law.name: fitted.by_tilt}, causes=("tilt",))]
    taken = abs(fit.tilt) * float(fit.surface - branch.height.min()) / force_of(law, branch, fit)
    if taken > _LARGE:
        what = f"the tilt of the baseline makes {taken:.0%} of the press's force over its depth"
        return [Flag("baseline-unclear", what)]
    return []
