"""The analysis of one press as a whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import BudgetRow, Flag, LogError

from palpate_indentation.adhesion import adhesive_law
from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.baseline import BaselineFit, fit_press
from palpate_indentation.contact_points import ContactPointResult, contact_points
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.modulus_over_depth import ModulusProfile, change_over_depth, secant_profile, tangent_profile
from palpate_indentation.press import Branch, Press
from palpate_indentation.press_budget import Declared, bound_of_viscosity, declared_rows, modulus_row
from palpate_indentation.press_flags import contributions, press_flags
from palpate_indentation.retract_theories import PullOff, Theory, pull_off, theories
from palpate_indentation.sphere_laws import SphereLawFit, poisson_ratio, sphere_laws, sphere_radius
from palpate_indentation.viscosity import PressViscosity, viscosity_of_press

Doubt = tuple[str, float | None, str, float]  # source, standard uncertainty, unit, contribution to the modulus


@dataclass(frozen=True)
class PressSettings:
    """Settings of the analysis of a press."""

    tilt: bool = True
    robust: bool = False
    bins: int = 40
    windows: int = 8
    retract: bool = False  # fit the way out in place of the way in


@dataclass(frozen=True)
class Indentation:
    """The analysis of one press."""

    law: ElasticLaw
    press: Press
    branch: Branch  # that was fitted
    baseline_fit: BaselineFit
    points: Mapping[str, ContactPointResult]
    secant: ModulusProfile
    tangent: ModulusProfile
    rise: tuple[float, float]  # relative change from the shallower to the deeper half, and its uncertainty
    spheres: tuple[SphereLawFit, ...]
    pull: PullOff | None
    theories: tuple[Theory, ...]
    radius: float | None  # [m] of a sphere
    flags: tuple[Flag, ...]
    without_adhesion: CurveFit | None  # fit of the pipeline's own law, where a theory of adhesion is `law`; else None
    viscosity: PressViscosity | None  # None: the model has none, or none that the force is proportional to
    budget: tuple[BudgetRow, ...]  # of everything, beginning with the fit itself

    @property
    def fit(self) -> CurveFit:
        """The estimate of least squares."""
        return self.baseline_fit.fit

    @property
    def combined(self) -> float:
        """Standard uncertainty of the modulus: the root of the sum of the budget's squares."""
        return float(np.linalg.norm(contributions(self.law, self.budget)))

    @property
    def depth(self) -> float:
        """Deepest depth [m]."""
        return float((self.fit.surface - self.branch.height).max())


@dataclass(frozen=True)
class _PressLaw:
    """The law of a press with its fit, and the uncertainties of the modulus that they leave open."""

    law: ElasticLaw
    baseline_fit: BaselineFit
    doubts: Sequence[Doubt]
    without_adhesion: CurveFit | None = None


def analyse_press(
    law: ElasticLaw,
    press: Press,
    settings: PressSettings,
    name: str = "record",
    *,
    viscosity: PressViscosity | None = None,
    declared: Declared | None = None,
) -> Indentation:
    """Return the analysis of a press by a law of its material; raises LogError, with the record's name, if none fits.

    The viscosity is the one that was stated, or else `viscosity`, that of the run, or else that of the press itself.
    `declared` are the uncertainties of readings, tip and model.
    """
    branch = press.approach
    if settings.retract:
        if press.retract is None:
            raise LogError(f"{name}: no way out to fit")
        branch = press.retract

    # The fit by the pipeline's own law, with the viscosity held; spheres by the other laws likewise.
    viscosity = _best_known_viscosity(law, press, branch, settings, viscosity)
    own_law = law if viscosity is None else law.with_viscosity(viscosity.value)
    own_fit = fit_press(own_law, branch, press.noise, name, tilt=settings.tilt, robust=settings.robust)
    tilt = settings.tilt and own_fit.undetermined is None
    spheres = sphere_laws(own_law, branch, press.noise, viscosity, tilt=tilt, robust=settings.robust)
    radius = sphere_radius(own_law.model)

    # From here on the law is that which explains the press, a theory of adhesion where one does.
    press_law = _press_law(own_law, press, branch, own_fit, viscosity, settings)
    best_law, fit = press_law.law, press_law.baseline_fit.fit
    budget = _budget(press_law, branch, declared or Declared())
    pull = pull_off(press.retract, press.noise) if press.retract is not None else None
    rise = _rise_over_depth(best_law, branch, fit, viscosity)
    return Indentation(
        best_law,
        press,
        branch,
        press_law.baseline_fit,
        points=contact_points(press, fit, branch),
        secant=secant_profile(best_law, branch, fit, settings.bins),
        tangent=tangent_profile(best_law, branch, fit, settings.windows),
        rise=rise,
        spheres=tuple(spheres),
        pull=pull,
        theories=_out_theories(best_law, press, fit, pull, radius),
        radius=radius,
        flags=tuple(press_flags(best_law, branch, press_law.baseline_fit, budget, rise, pull)),
        without_adhesion=press_law.without_adhesion,
        viscosity=viscosity,
        budget=budget,
    )


def _out_theories(
    law: ElasticLaw, press: Press, fit: CurveFit, pull: PullOff | None, radius: float | None
) -> tuple[Theory, ...]:
    """Return the theories of adhesion fitted to the way out of a sphere; none without a pull."""
    if pull is None or radius is None or press.retract is None:
        return ()
    return tuple(theories(press.retract, fit, pull, radius, poisson_ratio(law.model)))


def _best_known_viscosity(
    law: ElasticLaw, press: Press, branch: Branch, settings: PressSettings, of_run: PressViscosity | None
) -> PressViscosity | None:
    """Return the viscosity that was stated; else that of the run; else the one that the press shows or allows."""
    if law.viscosity is None:
        return None
    name, value, unit = law.viscosity
    if name in law.stated:
        return PressViscosity(value, 0.0, unit, "stated", "stated")
    return of_run if of_run is not None else viscosity_of_press(law, press, branch, tilt=settings.tilt)


def _press_law(
    law: ElasticLaw,
    press: Press,
    branch: Branch,
    own_fit: BaselineFit,
    viscosity: PressViscosity | None,
    settings: PressSettings,
) -> _PressLaw:
    """Return the law that explains a press: a theory of adhesion where one explains the way in better, else its own.

    No theory has a viscosity, so that none is tried where it is known.
    """
    fit = own_fit.fit
    adhesive = None
    is_viscosity_known = viscosity is not None and viscosity.source != "bound"
    if not settings.retract and not is_viscosity_known:
        adhesive = adhesive_law(law, branch, press.noise, fit, tilt=settings.tilt)
    if adhesive is None:
        tilt = settings.tilt and own_fit.undetermined is None
        by_viscosity = _viscosity_doubts(law, press, branch, fit, viscosity, tilt=tilt, robust=settings.robust)
        return _PressLaw(law, own_fit, [*by_viscosity, ("tilt", None, "", own_fit.by_tilt)])
    doubts: list[Doubt] = [("theory of adhesion", None, "", adhesive.ambiguity)]
    if viscosity is not None:
        bound, shift = bound_of_viscosity(adhesive.law, law, branch, adhesive.fit)
        doubts.append(("viscosity", bound, viscosity.unit, min(shift, adhesive.fit.modulus)))
    return _PressLaw(adhesive.law, BaselineFit(adhesive.fit, None), doubts, without_adhesion=fit)


def _viscosity_doubts(
    law: ElasticLaw, press: Press, branch: Branch, fit: CurveFit, viscosity: PressViscosity | None, **options: bool
) -> list[Doubt]:
    """Return the doubt by the viscosity: how far the modulus moves with its uncertainty, at most by all of it.

    By fits, since at one speed the viscous force has the shape of a surface that lies higher, so that a first order
    would show nothing (0231). None where no viscosity is uncertain; `options` are those of `fit_curve`.
    """
    if viscosity is None or viscosity.std == 0:
        return []
    # A viscosity is not below 0.
    signs = (1.0,) if viscosity.value < viscosity.std else (1.0, -1.0)
    laws = [law.with_viscosity(viscosity.value + sign * viscosity.std) for sign in signs]
    moduli = [fit_curve(moved_law, branch, press.noise, **options).modulus for moved_law in laws]
    shifts = [abs(modulus - fit.modulus) if np.isfinite(modulus) else fit.modulus for modulus in moduli]
    return [("viscosity", viscosity.std, viscosity.unit, min(float(np.mean(shifts)), fit.modulus))]


def _budget(press_law: _PressLaw, branch: Branch, declared: Declared) -> tuple[BudgetRow, ...]:
    """Return the budget of the modulus: the fit, the doubts that move it, and everything that is declared."""
    law, fit = press_law.law, press_law.baseline_fit.fit
    doubts = [doubt for doubt in press_law.doubts if doubt[3]]
    rows = [
        modulus_row(source, std, unit, contribution, law, fit)
        for source, std, unit, contribution in [("fit", None, "", fit.modulus_std), *doubts]
    ]
    return *rows, *declared_rows(law, branch, fit, declared)


def _rise_over_depth(
    law: ElasticLaw, branch: Branch, fit: CurveFit, viscosity: PressViscosity | None
) -> tuple[float, float]:
    """Return the relative change of the modulus over depth, and its uncertainty with that of the viscosity."""
    rise, std = change_over_depth(law, branch, fit)
    if law.viscosity_index is None or viscosity is None or viscosity.std == 0:
        return rise, std
    more_viscous = law.with_viscosity(viscosity.value + viscosity.std)
    by_viscosity = change_over_depth(more_viscous, branch, fit)[0] - rise
    return rise, float(np.hypot(std, by_viscosity))
