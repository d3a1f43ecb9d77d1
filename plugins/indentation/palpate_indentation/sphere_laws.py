"""The same sphere by other laws: as a paraboloid, as it is, and with large strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, ContactModel, Indenter
from palpate_engine import is_ball, registry as registries

from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.viscosity import PressViscosity


@dataclass(frozen=True)
class SphereLawFit:
    """A fit with another law of the tip."""

    tip: str
    fit: CurveFit
    chosen: bool  # it is the pipeline's own
    log_squares: float  # logarithm of the sum of squares that evidence counts


def sphere_radius(model: ContactModel) -> float | None:
    """Radius [m] of a model whose tip is a sphere by one of the laws; None for another."""
    tip = getattr(model, "indenter", None)
    return tip.sphere_radius if isinstance(tip, Indenter) else None


def sphere_laws(
    law: ElasticLaw, branch: Branch, noise: float, viscosity: PressViscosity | None, *, tilt: bool, robust: bool
) -> list[SphereLawFit]:
    """Return a fit for every law of a sphere that goes with the rest of the model; none for another tip.

    Evidence leaves every law free to choose the viscosity, within what is not known of it.
    """
    radius = sphere_radius(law.model)
    if radius is None:
        return []
    found, known = [], registries.load()
    for name in (name for name in known.parts["indenter"] if is_ball({"type": name}, known)):
        tip = known.find("indenter", name).model_validate({"radius": radius})
        chosen = type(tip) is type(law.model.indenter)  # type: ignore[attr-defined]
        try:
            fields = {key: getattr(law.model, key) for key in type(law.model).model_fields}
            model = law.model if chosen else type(law.model)(**{**fields, "indenter": tip})
        except ConfigurationError:  # a thickness correction that is for one of the laws only
            continue
        other = law.with_model(model)
        fit = fit_curve(other, branch, noise, tilt=tilt, robust=robust)
        squares = float(np.log(fit.residual @ fit.residual))
        if viscosity is not None and viscosity.std > 0:
            squares -= _gained(fit, fit_curve(other, branch, noise, tilt=tilt, viscous=True), viscosity.std)
        found.append(SphereLawFit(name, fit, chosen, squares))
    return found


def _gained(held: CurveFit, free: CurveFit, std: float) -> float:
    """By how much the logarithm of the squares falls where the viscosity is free within a standard uncertainty.

    The least sum of what the readings and what is known of the viscosity say, both square about their own best value.
    """
    most = float(np.log((held.residual @ held.residual) / (free.residual @ free.residual)))
    if not most > 0:
        return 0.0
    away = (free.viscosity / std) ** 2  # beyond what is held
    return most - 1.0 / (1.0 / most + held.effective / away) if away > 0 else most
