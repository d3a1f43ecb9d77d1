"""The specimens of the paper, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Elasticity by the dynamometer, viscosity as published for the tip of R = 5 mm; cylinders of 50 mm x 22 mm.
_CYLINDER = {"thickness": 0.022, "diameter": 0.05}
_HARD = {"elasticity": 282.1e3, "viscosity": 860.0, **_CYLINDER}
_SOFT = {"elasticity": 112.5e3, "viscosity": 362.0, **_CYLINDER}
# Contrasts as published: E of S3 and S4 over that of S2, 142.8 and 171.4 over 129.5 kPa. Sizes and depths are not
# stated.
_HORSESHOE = {"shape": "horseshoe", "bend": 0.008, "radius": 0.004, "angle": 1.5707963267948966, "peak": 0.103}
_SPHERE = {"shape": "sphere", "radius": 0.005, "peak": 0.324}

# Two slices of chicken breast of 15 mm each, by the paper's filter; the spread of its 10 palpations as that of places.
_CHICKEN = {"elasticity": 53.7e3, "viscosity": 623.0, "thickness": 0.03, "scatter": {"std": 5.2 / 53.7}}
_BETWEEN_SLICES = _SPHERE | {"radius": 0.0025, "peak": 102.7 / 53.7 - 1}

# Of S5 only the diameter and what is inside are stated: thickness and stiffness are taken from S2 to S4, places from
# the recorded sweep, in which the sphere and the horseshoe's bow are 22 to 28 mm apart.
SPECIMENS: Mapping[str, Mapping[str, Any]] = {
    "S1": _HARD,
    "S2": _SOFT,
    "S3": _SOFT | {"inclusions": (_HORSESHOE | {"place": (0.0, 0.008)},)},
    "S4": _SOFT | {"inclusions": (_SPHERE,)},
    "S5": _SOFT
    | {
        "diameter": 0.08,
        "inclusions": (_SPHERE | {"place": (0.0, -0.014)}, _HORSESHOE | {"place": (0.0, 0.022)}),
    },
    "chicken": _CHICKEN,
    "chicken-sphere": _CHICKEN | {"inclusions": (_BETWEEN_SLICES,)},
}
