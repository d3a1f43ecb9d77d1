"""The area of a tip in the reduced plane, in which the force of a linear material is linear."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import ContactModel, Floats

_MIN_DEPTH = 1e-9  # [m] of a tip's profile where the tip is out of contact: a choice, below any reading


def poisson_of(model: Any) -> float:
    """Return Poisson's ratio of a model that has one."""
    return float(model.poisson)


def reduced_area(model: ContactModel, depth: Floats) -> Floats:
    """Return the area A(d) c(d) (n,) [m^2] of a model's tip in the reduced plane at depths (n,) [m]; 0 out of contact.

    c is the factor of the layer. With a model of the skin the area is the skin's.
    """
    contact: Any = model
    positive_depth = np.maximum(depth, _MIN_DEPTH)
    if (skin := getattr(contact, "skin", None)) is not None:
        skin_area = skin.contact(contact.indenter, contact.thickness, contact.poisson, positive_depth)[0]
        return np.where(depth > 0, skin_area, 0.0)
    area = np.asarray(contact.indenter.profile_area(positive_depth))
    thickness = getattr(contact, "thickness", None)
    if thickness is not None and not isinstance(thickness, str):  # "half-space"
        area = area * np.asarray(thickness.factor(contact.indenter, positive_depth)[0])
    return np.where(depth > 0, area, 0.0)
