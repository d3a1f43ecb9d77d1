"""Tips: rigid, axisymmetric, pressed along their axis into a flat surface."""

from palpate_models.indenters.cones import BluntCone, Cone, TruncatedCone
from palpate_models.indenters.power_profiles import Flat, Paraboloid, Power, Quartic, Sphere
from palpate_models.indenters.profile import Profile
from palpate_models.indenters.spheres import Ellipsoid, ExactSphere, NeoHookeanSphere
from palpate_models.indenters.tilted_flat import TiltedFlat

__all__ = [
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
]
