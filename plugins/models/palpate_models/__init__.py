"""Contact models and tips."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Diagnosis, FlagMeaning, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_models.adhesion import (
        DerjaguinMullerToporov as DerjaguinMullerToporov,
        JohnsonKendallRoberts as JohnsonKendallRoberts,
    )
    from palpate_models.dimensionality_reduction import DimensionalityReduction as DimensionalityReduction
    from palpate_models.fractional import FractionalKelvinVoigt as FractionalKelvinVoigt, PowerLaw as PowerLaw
    from palpate_models.fung import Fung as Fung
    from palpate_models.generalised_maxwell import (
        Burgers as Burgers,
        GeneralisedMaxwell2 as GeneralisedMaxwell2,
        GeneralisedMaxwell3 as GeneralisedMaxwell3,
        GeneralisedMaxwell4 as GeneralisedMaxwell4,
    )
    from palpate_models.hunt_crossley import FreeHuntCrossley as FreeHuntCrossley, HuntCrossley as HuntCrossley
    from palpate_models.indenters.cones import BluntCone as BluntCone, Cone as Cone, TruncatedCone as TruncatedCone
    from palpate_models.indenters.power_profiles import (
        Flat as Flat,
        Paraboloid as Paraboloid,
        Power as Power,
        Quartic as Quartic,
        Sphere as Sphere,
    )
    from palpate_models.indenters.profile import Profile as Profile
    from palpate_models.indenters.spheres import (
        Ellipsoid as Ellipsoid,
        ExactSphere as ExactSphere,
        NeoHookeanSphere as NeoHookeanSphere,
    )
    from palpate_models.indenters.tilted_flat import TiltedFlat as TiltedFlat
    from palpate_models.kelvin_voigt import KelvinVoigt as KelvinVoigt
    from palpate_models.plate_compression import PlateCompression as PlateCompression
    from palpate_models.poroelastic import Poroelastic as Poroelastic
    from palpate_models.relaxing_models import (
        DimensionalityReductionMaxwell as DimensionalityReductionMaxwell,
        Maxwell as Maxwell,
        StandardLinearSolid as StandardLinearSolid,
    )
    from palpate_models.two_layers import FreeTwoLayers as FreeTwoLayers, TwoLayers as TwoLayers


@plugin
def palpate_indenters() -> dict[str, str]:
    """Tips."""
    return {
        "sphere": "palpate_models.indenters.power_profiles:Sphere",
        "exact-sphere": "palpate_models.indenters.spheres:ExactSphere",
        "neo-hookean-sphere": "palpate_models.indenters.spheres:NeoHookeanSphere",
        "paraboloid": "palpate_models.indenters.power_profiles:Paraboloid",
        "ellipsoid": "palpate_models.indenters.spheres:Ellipsoid",
        "flat": "palpate_models.indenters.power_profiles:Flat",
        "tilted-flat": "palpate_models.indenters.tilted_flat:TiltedFlat",
        "cone": "palpate_models.indenters.cones:Cone",
        "blunt-cone": "palpate_models.indenters.cones:BluntCone",
        "truncated-cone": "palpate_models.indenters.cones:TruncatedCone",
        "quartic": "palpate_models.indenters.power_profiles:Quartic",
        "power": "palpate_models.indenters.power_profiles:Power",
        "profile": "palpate_models.indenters.profile:Profile",
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
    """Return the effect of a specimen's size."""
    return {
        "model thickness": Command(
            "palpate_models.thickness_command:thickness",
            "Factor of a specimen's size, as a table.",
        ),
    }


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """Numbers of a relaxing material that a record determines, and those that a ball, or a solid, would give."""
    return {
        "at-rest": Diagnosis("palpate_models.modulus_at_rest:at_rest", quick=True),
        "ball": Diagnosis("palpate_models.ball_alternative:ball_alternative", quick=True),
        "solid": Diagnosis("palpate_models.solid_alternative:solid_alternative", quick=True),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Meanings of its flags."""
    return {
        "still-fading": FlagMeaning(
            "doubtful",
            "The slowest part of a spectrum of times fades as long as the record: what is slower is in E at rest.",
            "Hold for five times the longest time found, or give E(t) within the record in place of E at rest.",
        ),
    }


__getattr__, __all__ = lazy_names(__name__, *palpate_indenters().values(), *palpate_models().values())
