"""The mistakes of laboratories, with their sizes; written down before any of them was run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from laboratory.palpation import Palpation


@dataclass(frozen=True)
class Mistake:
    """One kind: its name, what is wrong, and which settings of a palpation it changes."""

    name: str
    wrong: str
    changes: dict[str, Any] = field(default_factory=dict)

    def palpation(self) -> Palpation:
        """The palpation with this mistake."""
        return replace(Palpation(), **self.changes)


def _is(name: str, wrong: str, **changes: Any) -> Mistake:
    return Mistake(name, wrong, changes)


_POWER_LAW = tuple((0.06, float(time)) for time in 10.0 ** np.arange(-2.0, 1.01, 1.0 / 3.0))
_DEGREE = np.pi / 180

NONE = _is("nothing", "nothing is wrong")

TIP = (
    _is("radius-double", "the tip has twice the radius", radius=10e-3),
    _is("radius-worn", "the tip's radius is 5 % larger", radius=5.25e-3),
    _is("tip-flat", "a flat tip of 3 mm", tip="flat", radius=3e-3),
    _is("tip-cone", "a cone of the sphere's force at the mean depth", tip="cone"),
    _is("tip-deep", "a sphere, where the model has its paraboloid", tip="exact-sphere"),
    _is("glove", "a soft cover of 15 N/mm on the tip", glove=15e3),
    _is("mass-double", "280 g behind the sensor, not 140 g", tip_mass=0.28),
    _is("mass-none", "nothing behind the sensor, not 140 g", tip_mass=0.0),
    _is("meniscus", "water pulls the wet tip by 0.03 N", meniscus=0.03),
)

SPECIMEN = (
    _is("poisson", "Poisson's ratio is 0.2", poisson=0.2),
    _is("adhesion", "the skin sticks, 5 J/m^2 (JKR)", adhesion=5.0),
    _is("adhesion-weak", "the skin sticks, 1 J/m^2 (JKR)", adhesion=1.0),
    _is("fung", "strain hardening, b = 1 (Fung)", fung=1.0),
    _is("large-strain", "a neo-Hookean half-space: 1 - 0.15 d/R", softening_strain=0.15),
    _is("layer-15", "a layer of 15 mm, bonded", height=15e-3),
    _is("layer-40", "a layer of 40 mm, bonded", height=40e-3),
    _is("two-layers", "a skin of 1 mm, half as stiff", skin=(1e-3, 0.5)),
    _is("lump", "a hard sphere 4 mm below the tip", lump=(0.325, 3.05e-3)),
    _is("lump-deep", "a hard sphere 9 mm below the tip", lump=(0.063, 3.05e-3)),
    _is("curved", "a convex skin of 25 mm", curvature=25e-3),
    _is("tilt", "the skin is tilted by 20 degrees", tilt=20 * _DEGREE),
    _is("tilt-friction", "tilted by 20 degrees, with friction 0.3", tilt=20 * _DEGREE, friction=0.3),
    _is("power-law", "a power-law material", branches=_POWER_LAW),
    _is("relaxing", "a share of 0.3 relaxes in 0.3 s", branches=((0.3, 0.3),)),
    _is("relaxing-fast", "a share of 0.3 relaxes in 0.03 s", branches=((0.3, 0.03),)),
    _is("relaxing-slow", "a share of 0.3 relaxes in 3 s", branches=((0.3, 3.0),)),
    _is("two-times", "shares of 0.2 relax in 0.05 s and in 1 s", branches=((0.2, 0.05), (0.2, 1.0))),
    _is("mullins", "15 % of the stiffness go in the first seconds", softening=0.15),
    _is("drying", "10 % stiffer after 10 s", drying=0.1),
    _is("swelling", "the surface rises by 0.1 mm", swelling=0.1e-3),
    _is("creep", "the specimen sinks by 0.3 mm", creep=0.3e-3),
    _is("slip", "the specimen slips by 0.4 mm once", slip=0.4e-3),
    _is("slide", "the specimen follows the tip by 0.1 mm at each turn", slide=0.1e-3),
    _is("breathing", "the surface breathes, 0.4 mm at 0.25 Hz", breathing=(0.4e-3, 0.25)),
    _is("pulse", "the surface beats, 0.1 mm at 1.2 Hz", breathing=(0.1e-3, 1.2)),
    _is("water", "in water: buoyancy 0.5 N/m and drag 0.5 N s/m", liquid=0.5, drag=0.5),
    _is("oil", "in oil: drag 5 N s/m", liquid=0.5, drag=5.0),
    _is("lift-off", "the tip leaves at each turn", depth=2.2e-3, amplitude=2.4e-3),
)

RIG = (
    _is("base-20", "the arm or the base gives, 20 N/mm", base=20e3),
    _is("base-5", "the arm or the base gives, 5 N/mm", base=5e3),
    _is("backlash", "0.1 mm of play in the arm", backlash=0.1e-3),
    _is("tremor", "the arm trembles, 20 um at 12 Hz", tremor=(20e-6, 12.0)),
    _is("floor", "the floor swings, 30 um at 17 Hz", tremor=(30e-6, 17.0)),
    _is("bump", "someone bumps the table, 0.2 mm", bump=0.2e-3),
    _is("thermal", "the arm grows by 0.05 mm", thermal=0.05e-3),
    _is("wait", "the robot stands still for 0.5 s", wait=0.5),
    _is("height-scale", "heights are 3 % too large", height_gain=1.03),
    _is("encoder-disc", "an encoder's error of 20 um, 1 mm long", height_curve=20e-6),
)

FORCE = (
    _is("gain", "the force reads 8 % too much", gain=1.08),
    _is("curve", "the force's curve is bent, 3 % at 5 N", curve=0.03),
    _is("zero-step", "the zero moves by 0.25 N once", zero_step=0.25),
    _is("zero-drift", "the zero drifts by 0.05 N/s", zero_drift=0.05),
    _is("warm-up", "the sensor warms up, 0.3 N in 5 s", warm_up=0.3),
    _is("ac-coupled", "an AC-coupled sensor, 0.1 Hz", coupling=0.1),
    _is("ac-slow", "an AC-coupled sensor, 0.01 Hz", coupling=0.01),
    _is("alias", "an alias of 0.1 N at the motion's frequency", tone=(0.1, 2.0, np.pi / 2)),
    _is("alias-near", "an alias of 0.1 N at 2.1 Hz", tone=(0.1, 2.1, 0.0)),
    _is("hum", "mains hum, 0.3 N at 50 Hz", tone=(0.3, 50.0, 0.0)),
    _is("pickup", "the motor's current reads as 5 N s/m", pickup=5.0),
    _is("force-digits", "steps of 0.1 N", force_step=0.1),
    _is("low-pass", "a low-pass of 10 Hz left on", low_pass=10.0),
    _is("force-mean", "a moving average of 20 samples left on", force_mean=20),
    _is("cross-talk", "a cable, or 30 N/m of cross-talk", cable=30.0),
    _is("guide", "friction of 0.1 N in a guide", guide=0.1),
    _is("hysteresis", "hysteresis of 0.1 N", play=0.1),
    _is("ringing", "the tool rings, 40 Hz", ringing=(40.0, 0.05)),
    _is("saturation", "saturation at 4.2 N", most=4.2),
    _is("stuck", "the force stands still for 0.3 s", stuck=0.3),
    _is("spikes", "0.5 % of readings off by 2 N", spikes=0.005),
    _is("zeros", "0.5 % of readings are 0", zeros=0.005),
    _is("held", "a sensor of 50 Hz, each reading 10 times", held=10),
    _is("noise", "five times the noise", force_noise=0.25),
    _is("noise-coloured", "filtered noise", colour=0.8),
    _is("tare-loaded", "tared with the tip 1 mm in the skin", start_depth=1e-3),
    _is("sign", "the force has the wrong sign", gain=-1.0),
    _is("gram", "grams for newtons", force_unit=1e3 / 9.80665),
    _is("kilogram", "kilograms-force for newtons", force_unit=1 / 9.80665),
)

LOG = (
    _is("commanded", "the log has the command, 8 ms ahead", commanded=8e-3),
    _is("commanded-lag", "the log has the command, 30 ms ahead", commanded=30e-3),
    _is("position-digits", "heights in steps of 0.1 mm", position_step=0.1e-3),
    _is("position-mean", "height and velocity averaged over 15 samples", position_mean=15),
    _is("velocity-mean", "velocity averaged over 21 samples", velocity_mean=21),
    _is("velocity-late", "the velocity is 2 ms late", velocity_late=2e-3),
    _is("force-late", "the force is 6 ms late", force_late=6e-3),
    _is("force-late-1", "the force is 1 ms late", force_late=1e-3),
    _is("motion-late", "height and velocity are 4 ms late", position_late=4e-3),
    _is("jitter", "stamps jitter by 1 ms, with gaps", jitter=1e-3, gaps=5),
    _is("stamp-digits", "stamps in steps of 10 ms", stamp_step=10e-3),
    _is("clock", "the force's clock gains 5 ms in 10 s", clock=5e-4),
    _is("rate", "520 Hz written as 500 Hz", rate_error=0.04),
    _is("lost", "5 % of rows lost", lost=0.05),
    _is("doubled", "2 % of rows twice", doubled=0.02),
    _is("millimetre", "millimetres for metres", motion_unit=1e3),
    _is("velocity-unit", "the velocity in mm/s, the height in m", velocity_unit=1e3),
    _is("velocity-zero", "the velocity of another axis", velocity_unit=0.0),
    _is("velocity-sign", "the velocity counts downwards", velocity_unit=-1.0),
)

TOGETHER = (
    _is(
        "several-small",
        "gain 1 %, height 1 %, base 100 N/mm, tilt 5 degrees, 0.3 ms late, zero 0.05 N",
        gain=1.01,
        height_gain=1.01,
        base=100e3,
        tilt=5 * _DEGREE,
        force_late=0.3e-3,
        zero_step=0.05,
    ),
    _is(
        "several",
        "relaxing share 0.1, base 40 N/mm, drift 0.02 N/s, 1 ms late, radius 2 %",
        branches=((0.1, 0.3),),
        base=40e3,
        zero_drift=0.02,
        force_late=1e-3,
        radius=5.1e-3,
    ),
    _is(
        "old-log",
        "force averaged over 5, velocity over 11 samples, steps of 0.05 N and 20 um, gaps",
        force_mean=5,
        velocity_mean=11,
        force_step=0.05,
        position_step=20e-6,
        gaps=3,
    ),
)

KINDS = (NONE, *TIP, *SPECIMEN, *RIG, *FORCE, *LOG, *TOGETHER)
