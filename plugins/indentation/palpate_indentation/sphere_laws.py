"""The same sphere by other laws: as a paraboloid, as it is, and with large strain."""

from __future__ import annotations

from dataclasses import dataclass

from palpate import ContactModel
from palpate.host import registry as registries
from pydantic import ValidationError

from palpate_indentation.approach_fit import CurveFit, fit_curve
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

SPHERES = ("sphere", "exact-sphere", "neo-hookean-sphere")


@dataclass(frozen=True)
class SphereLawFit:
    """A fit with another law of the tip."""

    tip: str
    fit: CurveFit
    chosen: bool  # it is the pipeline's own


def sphere_radius(model: ContactModel) -> float | None:
    """Radius [m] of a model whose tip is a sphere by one of the laws; None for another."""
    parts = registries.load().parts["indenter"]
    tip = getattr(model, "indenter", None)
    if any(name in parts and type(tip) is parts[name].part for name in SPHERES):
        return float(tip.radius)  # type: ignore[union-attr]
    return None


def sphere_laws(law: ElasticLaw, branch: Branch, noise: float, *, tilt: bool, robust: bool) -> list[SphereLawFit]:
    """A fit for every law of a sphere that goes with the rest of the model; none for another tip."""
    radius = sphere_radius(law.model)
    if radius is None:
        return []
    found, parts = [], registries.load().parts["indenter"]
    for name in (name for name in SPHERES if name in parts):
        tip = parts[name].part.model_validate({"radius": radius})
        chosen = type(tip) is type(law.model.indenter)  # type: ignore[attr-defined]
        try:
            fields = {key: getattr(law.model, key) for key in type(law.model).model_fields}
            model = law.model if chosen else type(law.model)(**{**fields, "indenter": tip})
        except ValidationError:  # a thickness correction that is for one of the laws only
            continue
        found.append(
            SphereLawFit(name, fit_curve(law.with_model(model), branch, noise, tilt=tilt, robust=robust), chosen)
        )
    return found
