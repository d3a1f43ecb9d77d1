"""Contact models and tips."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import Command, Diagnosis, FlagMeaning, plugin

if TYPE_CHECKING:
    from palpate import Indenter

    from palpate_models.adhesion import DerjaguinMullerToporov, JohnsonKendallRoberts
    from palpate_models.dimensionality_reduction import DimensionalityReduction
    from palpate_models.fractional import FractionalKelvinVoigt, PowerLaw
    from palpate_models.fung import Fung
    from palpate_models.generalised_maxwell import (
        Burgers,
        GeneralisedMaxwell2,
        GeneralisedMaxwell3,
        GeneralisedMaxwell4,
    )
    from palpate_models.hunt_crossley import FreeHuntCrossley, HuntCrossley
    from palpate_models.indenters import (
        BluntCone,
        Cone,
        Ellipsoid,
        ExactSphere,
        Flat,
        NeoHookeanSphere,
        Paraboloid,
        Power,
        Profile,
        Quartic,
        Sphere,
        TiltedFlat,
        TruncatedCone,
    )
    from palpate_models.kelvin_voigt import KelvinVoigt
    from palpate_models.plate_compression import PlateCompression
    from palpate_models.poroelastic import Poroelastic
    from palpate_models.relaxing_models import DimensionalityReductionMaxwell, Maxwell, StandardLinearSolid
    from palpate_models.two_layers import FreeTwoLayers, TwoLayers

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "adhesion": ["DerjaguinMullerToporov", "JohnsonKendallRoberts"],
        "generalised_maxwell": ["Burgers", "GeneralisedMaxwell2", "GeneralisedMaxwell3", "GeneralisedMaxwell4"],
        "plate_compression": ["PlateCompression"],
        "dimensionality_reduction": ["DimensionalityReduction"],
        "fractional": ["FractionalKelvinVoigt", "PowerLaw"],
        "hunt_crossley": ["FreeHuntCrossley", "HuntCrossley"],
        "indenters": [
            "BluntCone",
            "Cone",
            "Ellipsoid",
            "ExactSphere",
            "Flat",
            "NeoHookeanSphere",
            "Paraboloid",
            "Power",
            "Profile",
            "Quartic",
            "Sphere",
            "TiltedFlat",
            "TruncatedCone",
        ],
        "kelvin_voigt": ["KelvinVoigt"],
        "poroelastic": ["Poroelastic"],
        "fung": ["Fung"],
        "two_layers": ["FreeTwoLayers", "TwoLayers"],
        "relaxing_models": ["DimensionalityReductionMaxwell", "Maxwell", "StandardLinearSolid"],
    },
)

__all__ = [
    "BluntCone",
    "Burgers",
    "Cone",
    "DerjaguinMullerToporov",
    "DimensionalityReduction",
    "DimensionalityReductionMaxwell",
    "Ellipsoid",
    "ExactSphere",
    "Flat",
    "FractionalKelvinVoigt",
    "FreeHuntCrossley",
    "FreeTwoLayers",
    "Fung",
    "GeneralisedMaxwell2",
    "GeneralisedMaxwell3",
    "GeneralisedMaxwell4",
    "HuntCrossley",
    "JohnsonKendallRoberts",
    "KelvinVoigt",
    "Maxwell",
    "NeoHookeanSphere",
    "Paraboloid",
    "PlateCompression",
    "Poroelastic",
    "Power",
    "PowerLaw",
    "Profile",
    "Quartic",
    "Sphere",
    "StandardLinearSolid",
    "TiltedFlat",
    "TruncatedCone",
    "TwoLayers",
]


@plugin
def palpate_indenters() -> dict[str, type[Indenter]]:
    """Tips."""
    from palpate_models.indenters import (
        BluntCone,
        Cone,
        Ellipsoid,
        ExactSphere,
        Flat,
        NeoHookeanSphere,
        Paraboloid,
        Power,
        Profile,
        Quartic,
        Sphere,
        TiltedFlat,
        TruncatedCone,
    )

    return {
        "sphere": Sphere,
        "exact-sphere": ExactSphere,
        "neo-hookean-sphere": NeoHookeanSphere,
        "paraboloid": Paraboloid,
        "ellipsoid": Ellipsoid,
        "flat": Flat,
        "tilted-flat": TiltedFlat,
        "cone": Cone,
        "blunt-cone": BluntCone,
        "truncated-cone": TruncatedCone,
        "quartic": Quartic,
        "power": Power,
        "profile": Profile,
    }


@plugin
def palpate_models() -> dict[str, str]:
    """Contact models."""
    return {
        "dimensionality-reduction": "palpate_models.dimensionality_reduction:DimensionalityReduction",
        "standard-linear-solid": "palpate_models.relaxing_models:StandardLinearSolid",
        "dimensionality-reduction-maxwell": "palpate_models.relaxing_models:DimensionalityReductionMaxwell",
        "maxwell": "palpate_models.relaxing_models:Maxwell",
        "generalised-maxwell-2": "palpate_models.generalised_maxwell:GeneralisedMaxwell2",
        "generalised-maxwell-3": "palpate_models.generalised_maxwell:GeneralisedMaxwell3",
        "generalised-maxwell-4": "palpate_models.generalised_maxwell:GeneralisedMaxwell4",
        "burgers": "palpate_models.generalised_maxwell:Burgers",
        "power-law": "palpate_models.fractional:PowerLaw",
        "fractional-kelvin-voigt": "palpate_models.fractional:FractionalKelvinVoigt",
        "poroelastic": "palpate_models.poroelastic:Poroelastic",
        "kelvin-voigt": "palpate_models.kelvin_voigt:KelvinVoigt",
        "hunt-crossley": "palpate_models.hunt_crossley:HuntCrossley",
        "hunt-crossley-free": "palpate_models.hunt_crossley:FreeHuntCrossley",
        "fung": "palpate_models.fung:Fung",
        "two-layers": "palpate_models.two_layers:TwoLayers",
        "two-layers-free": "palpate_models.two_layers:FreeTwoLayers",
        "compression": "palpate_models.plate_compression:PlateCompression",
        "dmt": "palpate_models.adhesion:DerjaguinMullerToporov",
        "jkr": "palpate_models.adhesion:JohnsonKendallRoberts",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """What a specimen's size does."""
    return {
        "model thickness": Command(
            "palpate_models.thickness_command:thickness",
            "Factor of a specimen's size, as a table.",
        ),
    }


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """What a record determines of a relaxing material, and what a ball would give."""
    return {
        "at-rest": Diagnosis("palpate_models.modulus_at_rest:at_rest", quick=True),
        "ball": Diagnosis("palpate_models.ball_alternative:ball_alternative", quick=True),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """What its flags mean."""
    return {
        "still-fading": FlagMeaning(
            "doubtful",
            "The slowest part of a spectrum of times fades as long as the record: what is slower is in E at rest.",
            "Hold for five times the longest time found, or give E(t) within the record in place of E at rest.",
        ),
    }
