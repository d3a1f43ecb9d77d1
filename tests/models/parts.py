"""Every shipped tip and model with settings that suit it; a test fails where a new one is not listed here."""

from __future__ import annotations

import math

from palpate import ContactModel, Indenter
from palpate.offers import import_target
from palpate_models import palpate_indenters, palpate_models
from palpate_models.thickness import Thickness

ANGLE = math.radians(30)
SPHERE = {"formula": "R - sqrt(R**2 - r**2)", "constants": {"R": 5e-3}, "radius": 4.95e-3}

_TIPS = {
    "sphere": {"radius": 5e-3},
    "exact-sphere": {"radius": 5e-3},
    "neo-hookean-sphere": {"radius": 5e-3},
    "paraboloid": {"curvature_radius": 5e-3},
    "ellipsoid": {"radius": 4e-3, "height": 7e-3},
    "flat": {"radius": 5e-3},
    "tilted-flat": {"radius": 5e-3, "tilt": math.radians(2)},
    "cone": {"angle": ANGLE},
    "blunt-cone": {"angle": ANGLE, "tip_radius": 1e-3},
    "truncated-cone": {"angle": ANGLE, "face_radius": 1e-3},
    "quartic": {"coefficient": 1e7},
    "power": {"exponent": 3.0, "coefficient": 2e4},
    "profile": SPHERE,
}
TIPS: dict[str, Indenter] = {name: part(**_TIPS[name]) for name, part in palpate_indenters().items()}

_SPHERE_TIP = TIPS["exact-sphere"]
_MODELS = {
    "dimensionality-reduction": ({"indenter": _SPHERE_TIP}, [1e5, 300.0]),
    "standard-linear-solid": ({"indenter": _SPHERE_TIP}, [1e5, 2e4, 0.1]),
    "dimensionality-reduction-maxwell": ({"indenter": _SPHERE_TIP}, [1e5, 300.0, 2e4, 0.1]),
    "maxwell": ({"indenter": _SPHERE_TIP}, [1e5, 2e4]),
    "generalised-maxwell-2": ({"indenter": _SPHERE_TIP}, [1e5, 2e4, 0.05, 1e4, 0.5]),
    "generalised-maxwell-3": ({"indenter": _SPHERE_TIP}, [1e5, 2e4, 0.05, 1e4, 0.5, 5e3, 5.0]),
    "generalised-maxwell-4": ({"indenter": _SPHERE_TIP}, [1e5, 2e4, 0.05, 1e4, 0.5, 5e3, 5.0, 5e3, 50.0]),
    "burgers": ({"indenter": _SPHERE_TIP}, [1e5, 2e5, 2e5, 2e3]),
    "power-law": ({"indenter": _SPHERE_TIP}, [1e5, 0.15]),
    "fractional-kelvin-voigt": ({"indenter": _SPHERE_TIP}, [1e5, 2e4, 0.3]),
    "poroelastic": ({"indenter": _SPHERE_TIP}, [1e5, 0.2, 1e-6]),
    "kelvin-voigt": ({"indenter": TIPS["flat"]}, [1000.0, 10.0]),
    "hunt-crossley": ({"indenter": TIPS["sphere"]}, [1.0, 10.0]),
    "hunt-crossley-free": ({"indenter": TIPS["sphere"]}, [1.0, 10.0, 1.5]),
    "dmt": ({"radius": 5e-3}, [1e5, 0.05]),
    "jkr": ({"radius": 5e-3}, [1e5, 0.05]),
    "fung": ({"indenter": TIPS["sphere"]}, [1e5, 300.0, 2.0]),
    "two-layers": ({"indenter": TIPS["sphere"], "skin_thickness": 3e-3}, [2e5, 5e4, 300.0]),
    "two-layers-free": ({"indenter": TIPS["sphere"]}, [2e5, 5e4, 300.0, 3e-3]),
    "compression": ({"diameter": 51e-3, "height": 22e-3}, [1e5]),
}
MODELS: dict[str, tuple[ContactModel, list[float]]] = {
    name: (import_target(place)(**_MODELS[name][0]), _MODELS[name][1]) for name, place in palpate_models().items()
}

THICKNESSES = {
    "dimitriadis-bonded": Thickness(law="dimitriadis", height=22e-3),
    "dimitriadis-free": Thickness(law="dimitriadis", height=22e-3, bonded=False),
    "garcia": Thickness(law="garcia", height=22e-3),
    "cylinder-bonded": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3),
    "cylinder-free": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3, bonded=False),
    "cylinder-sticking": Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3, sticking=True),
}
