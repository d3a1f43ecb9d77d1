"""The same sphere by other laws: as a paraboloid, with its true shape, and with large strain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, ContactModel, Indenter
from palpate_engine import is_ball, registry as registries

from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.viscosity import PressViscosity

_INCOMPRESSIBLE = 0.5  # Poisson's ratio


@dataclass(frozen=True)
class SphereLawFit:
    """A fit with another law of the tip."""

    tip: str
    fit: CurveFit
    chosen: bool  # True for the law of the pipeline's own tip
    log_squares: float  # logarithm of the sum of squares [N^2] that evidence counts


def sphere_radius(model: ContactModel) -> float | None:
    """Return the radius [m] of a model whose tip is a sphere by one of the laws; None for another."""
    tip = getattr(model, "indenter", None)
    return tip.sphere_radius if isinstance(tip, Indenter) else None


def poisson_ratio(model: ContactModel) -> float:
    """Return Poisson's ratio of a model; that of an incompressible material for a model without one."""
    return float(getattr(model, "poisson", _INCOMPRESSIBLE))


def sphere_laws(
    law: ElasticLaw, branch: Branch, noise: float, viscosity: PressViscosity | None, *, tilt: bool, robust: bool
) -> list[SphereLawFit]:
    """Return a fit for every law of a sphere that goes with the rest of the model; none for another tip.

    Evidence permits each law its own viscosity, within the uncertainty of the viscosity that is known.
    """
    fits = []
    for tip_name, sphere_law, is_chosen in _alternative_laws(law):
        fit = fit_curve(sphere_law, branch, noise, tilt=tilt, robust=robust)
        log_squares = float(np.log(fit.residual @ fit.residual))
        if viscosity is not None and viscosity.std > 0:
            free_fit = fit_curve(sphere_law, branch, noise, tilt=tilt, viscous=True)
            log_squares -= _log_squares_gain(fit, free_fit, viscosity.std)
        fits.append(SphereLawFit(tip_name, fit, is_chosen, log_squares))
    return fits


def _alternative_laws(law: ElasticLaw) -> Iterator[tuple[str, ElasticLaw, bool]]:
    """Yield the name of every tip that is a sphere, the law with it, and True for the tip of the law itself."""
    radius = sphere_radius(law.model)
    if radius is None:
        return
    registry = registries.load()
    for name in registry.parts["indenter"]:
        if not is_ball({"type": name}, registry):
            continue
        tip = registry.find("indenter", name).model_validate({"radius": radius})
        is_chosen = type(tip) is type(law.model.indenter)  # type: ignore[attr-defined]
        try:
            settings = {key: getattr(law.model, key) for key in type(law.model).model_fields}
            model = law.model if is_chosen else type(law.model)(**{**settings, "indenter": tip})
        except ConfigurationError:  # a thickness correction that is for one of the laws only
            continue
        yield name, law.with_model(model), is_chosen


def _log_squares_gain(held: CurveFit, free: CurveFit, std: float) -> float:
    """Return by how much the logarithm of the sum of squares falls if the viscosity may move within its uncertainty.

    The minimum over the viscosity of the sum of two parabolas: that of the readings, about the `free` estimate, of gain
    g in n effective samples, and that of the known value, whose standard uncertainty is `std`. With a, the squared
    distance of the two minima in units of `std`, the gain is g - 1/(1/g + n/a).
    """
    gain = float(np.log((held.residual @ held.residual) / (free.residual @ free.residual)))
    if not gain > 0:
        return 0.0
    distance = (free.viscosity / std) ** 2  # of the free viscosity, which is beyond the held one
    return gain - 1.0 / (1.0 / gain + held.effective / distance) if distance > 0 else gain
