"""Adhesion on the way in: the theory that explains it better than a law without adhesion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate_engine import registry as registries

from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.sphere_laws import poisson_ratio, sphere_radius

_JKR_PULL = 1.5 * np.pi  # largest pull over w R (Johnson, Kendall and Roberts 1971)
_DMT_PULL = 2.0 * np.pi  # the same (Derjaguin, Muller and Toporov 1975)
PULL_OF_THEORY = {"dmt": _DMT_PULL, "jkr": _JKR_PULL}  # by the name of the model
_ATTRACTION_RANGE = 3e-10  # [m] between surfaces, in Tabor's parameter: a property of surfaces (0231)

# A theory for the way in.
_MIN_CORRELATION_TIME = 1.5  # samples, a choice: a residual that is correlated over more is not noise alone
_MIN_WORK_SIGMAS = 3.0  # standard uncertainties of the work of adhesion (0366)
_MIN_BIC_DIFFERENCE = 10.0  # very strong evidence (Kass and Raftery 1995; 0366)


@dataclass(frozen=True)
class AdhesiveLaw:
    """The theory of adhesion that explains a way in, and its fit."""

    law: ElasticLaw
    fit: CurveFit
    ambiguity: float  # [Pa] distance of the modulus by another theory that explains the way in as well; 0: none does


def adhesive_law(law: ElasticLaw, branch: Branch, noise: float, plain: CurveFit, *, tilt: bool) -> AdhesiveLaw | None:
    """Return the theory of a sphere that explains a way in better than the law without adhesion; None where none does.

    Sought only where the residual of the `plain` fit is correlated, so that something is not in its law. `noise` [N] is
    that of one reading.
    """
    radius, poisson = sphere_radius(law.model), poisson_ratio(law.model)
    if radius is None or law.unit != "Pa" or plain.correlation_time < _MIN_CORRELATION_TIME:
        return None
    candidates = list(_candidates(law, branch, noise, plain, installed_theories(radius, poisson), tilt=tilt))
    if not candidates:
        return None

    # Evidence, 10 of BIC, against the law without adhesion, whose fit has one unknown less, and between the theories.
    best, *worse = sorted(candidates, key=lambda candidate: candidate.fit.rms)
    if not best.fit.bic_above(plain, 1) < -_MIN_BIC_DIFFERENCE:
        return None
    rivals = [other.fit for other in worse if other.fit.bic_above(best.fit, 0) < _MIN_BIC_DIFFERENCE]
    distances = [rival.modulus - best.fit.modulus for rival in rivals]
    return replace(best, ambiguity=float(np.max(np.abs(distances), initial=0.0)))


def _candidates(
    law: ElasticLaw, branch: Branch, noise: float, plain: CurveFit, models: Mapping[str, Any], *, tilt: bool
) -> Iterator[AdhesiveLaw]:
    """Yield the theories whose work of adhesion is beyond three standard uncertainties, fitted to a way in.

    The search begins between an adhesion whose pull is the noise [N] and one whose pull is the largest force.
    """
    radius = sphere_radius(law.model)
    assert radius is not None
    noise_adhesion = noise / (_JKR_PULL * radius * plain.modulus)  # [m] work over modulus
    force_over_noise = float(plain.modulus * law.geometry(plain.surface - branch.height).max()) / noise
    start_adhesion = noise_adhesion * np.sqrt(max(force_over_noise, 1.0))
    for model in models.values():
        start_law = ElasticLaw(model, law.name, law.unit, 0, (0.0, 0.0), adhesion=start_adhesion)
        fit = fit_curve(start_law, branch, noise, tilt=tilt)
        is_finite = np.isfinite([fit.modulus, fit.modulus_std]).all()
        if is_finite and fit.work > _MIN_WORK_SIGMAS * fit.work_std:
            yield AdhesiveLaw(replace(start_law, adhesion=fit.work / fit.modulus), fit, ambiguity=0.0)


def installed_theories(radius: float, poisson: float) -> dict[str, Any]:
    """Return the theories that are installed, by name."""
    parts = registries.load().parts["model"]
    settings = {"radius": radius, "poisson": poisson}
    return {name: parts[name].part.model_validate(settings) for name in PULL_OF_THEORY if name in parts}


def tabor(radius: float, work: float, modulus: float, poisson: float) -> float:
    """Return (R w^2/(E*^2 z0^3))^(1/3): above 5 the contact is JKR's, below 0.1 DMT's (Tabor 1977)."""
    plane_modulus = modulus / (1.0 - poisson**2)
    return float((radius * work**2 / (plane_modulus**2 * _ATTRACTION_RANGE**3)) ** (1 / 3))
