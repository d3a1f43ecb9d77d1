"""Every shipped tip, with the settings of its example, and every model."""

from __future__ import annotations

from pathlib import Path

from palpate import ContactModel, Indenter
from palpate.offers import import_target
from palpate_engine import Source, build_parts
from palpate_models import palpate_models
from palpate_models.thickness import Thickness

EXAMPLE = Path(__file__).parents[2] / "pipelines" / "parts" / "tips.toml"
TIPS: dict[str, Indenter] = build_parts(Source.read(EXAMPLE, named=False), "indenter")

# Settings of a model that it cannot do without, or that its derived values need.
_SETTINGS = {
    "kelvin-voigt": {"indenter": TIPS["flat"]},
    "hunt-crossley": {"indenter": TIPS["sphere"]},
    "hunt-crossley-free": {"indenter": TIPS["sphere"]},
    "dmt": {"radius": 5e-3},
    "jkr": {"radius": 5e-3},
    "two-layers": {"indenter": TIPS["sphere"], "skin_thickness": 3e-3},
    "compression": {"diameter": 51e-3, "height": 22e-3},
}


def _example(name: str, target: str) -> tuple[ContactModel, list[float]]:
    """Return a model under a ball of 5 mm, with the parameters at which a fit begins."""
    part = import_target(target)
    tip_setting = {"indenter": TIPS["exact-sphere"]} if "indenter" in part.model_fields else {}
    model = part(**{**tip_setting, **_SETTINGS.get(name, {})})
    return model, [parameter.start for parameter in model.parameters]


MODELS = {name: _example(name, target) for name, target in palpate_models().items()}

THICKNESSES = {
    "dimitriadis-bonded": Thickness(law="dimitriadis", height=22e-3),
    "dimitriadis-free": Thickness(law="dimitriadis", height=22e-3, bonded=False),
    "garcia": Thickness(law="garcia", height=22e-3),
    "cylinder-bonded": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3),
    "cylinder-free": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3, bonded=False),
    "cylinder-sticking": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3, sticking=True),
}
