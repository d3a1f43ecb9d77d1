"""The parameters that several models share: one name, one symbol, one unit, one meaning."""

from __future__ import annotations

from palpate import Parameter

# First guesses are of the order that soft silicone and tissue have under a tip of a few millimetres.
ELASTICITY = Parameter(
    "elasticity", "E", "Pa", "Young's modulus of the material", role="elastic", start=50e3, start_std=200e3
)
VISCOSITY = Parameter(
    "viscosity", "eta", "Pa*s", "shear viscosity of the material", role="viscous", start=300.0, start_std=1000.0
)
STIFFNESS = Parameter(
    "stiffness", "K", "N/m", "force at rest per depth", role="elastic", start=1000.0, start_std=5000.0
)
DAMPING = Parameter("damping", "B", "N*s/m", "force per speed", role="viscous", start=10.0, start_std=100.0)
REFERENCE_FORCE = Parameter(
    "reference_force",
    "K_c",
    "N",
    "force at rest at a depth of 1 mm; the same number as Hunt and Crossley's K_c in N/mm^n",
    role="elastic",
    start=1.0,
    start_std=5.0,
)
REFERENCE_DAMPING = Parameter(
    "reference_damping",
    "B_c",
    "N*s/m",
    "force per speed at a depth of 1 mm; 1000 times Hunt and Crossley's B_c in N s/mm^(n+1)",
    role="viscous",
    start=10.0,
    start_std=100.0,
)
EXPONENT = Parameter(
    "exponent", "n", "1", "power of the depth in the force", lower=0.5, upper=4.0, start=1.5, start_std=0.3
)
RELAXING_ELASTICITY = Parameter(
    "relaxing_elasticity",
    "E_1",
    "Pa",
    "part of Young's modulus that acts at once and fades",
    start=20e3,
    start_std=50e3,
)
RELAXATION_TIME = Parameter(
    "relaxation_time", "tau", "s", "time in which the fading part falls to 1/e", start=0.1, start_std=0.2
)
LASTING_ELASTICITY = Parameter(
    ELASTICITY.name,
    "E",
    ELASTICITY.unit,
    "Young's modulus of the material at rest",
    role="elastic",
    start=ELASTICITY.start,
    start_std=ELASTICITY.start_std,
)
INSTANT_ELASTICITY = Parameter(
    ELASTICITY.name,
    "E",
    ELASTICITY.unit,
    "Young's modulus of the material, before it flows",
    start=ELASTICITY.start,
    start_std=ELASTICITY.start_std,
)
FLOW_VISCOSITY = Parameter(
    VISCOSITY.name,
    "eta",
    VISCOSITY.unit,
    "shear viscosity with which the material flows",
    start=10e3,
    start_std=50e3,
)
DASHPOT_VISCOSITY = Parameter(
    VISCOSITY.name,
    "eta",
    VISCOSITY.unit,
    "shear viscosity of the damper in parallel with spring and arm",
    role="viscous",
    start=VISCOSITY.start,
    start_std=VISCOSITY.start_std,
)
ADHESION_WORK = Parameter(
    "adhesion_work", "w", "J/m^2", "energy to separate tip and material, per area", start=0.05, start_std=0.1
)
