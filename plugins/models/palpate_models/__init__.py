"""Contact models and tips."""

from palpate import ContactModel, Indenter, plugin

from palpate_models.compression import Compression
from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_models.hunt_crossley import FreeHuntCrossley, HuntCrossley
from palpate_models.indenters import (
    BluntCone,
    Cone,
    Ellipsoid,
    ExactSphere,
    Flat,
    Paraboloid,
    Power,
    Profile,
    Quartic,
    Sphere,
    TruncatedCone,
)
from palpate_models.kelvin_voigt import KelvinVoigt
from palpate_models.relaxation import Maxwell, StandardLinearSolid

__all__ = [
    "BluntCone",
    "Compression",
    "Cone",
    "DimensionalityReduction",
    "Ellipsoid",
    "ExactSphere",
    "Flat",
    "FreeHuntCrossley",
    "HuntCrossley",
    "KelvinVoigt",
    "Maxwell",
    "Paraboloid",
    "Power",
    "Profile",
    "Quartic",
    "Sphere",
    "StandardLinearSolid",
    "TruncatedCone",
]


@plugin
def palpate_indenters() -> dict[str, type[Indenter]]:
    """Tips."""
    return {
        "sphere": Sphere,
        "exact-sphere": ExactSphere,
        "paraboloid": Paraboloid,
        "ellipsoid": Ellipsoid,
        "flat": Flat,
        "cone": Cone,
        "blunt-cone": BluntCone,
        "truncated-cone": TruncatedCone,
        "quartic": Quartic,
        "power": Power,
        "profile": Profile,
    }


@plugin
def palpate_models() -> dict[str, type[ContactModel]]:
    """Contact models."""
    return {
        "dimensionality-reduction": DimensionalityReduction,
        "standard-linear-solid": StandardLinearSolid,
        "maxwell": Maxwell,
        "kelvin-voigt": KelvinVoigt,
        "hunt-crossley": HuntCrossley,
        "hunt-crossley-free": FreeHuntCrossley,
        "compression": Compression,
    }
