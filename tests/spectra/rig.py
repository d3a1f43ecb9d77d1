"""Recordings as a rig would make them, from the models' own forces."""

import numpy as np
from palpate import contact_force, force_over_time
from palpate_spectra.recorded_oscillation import RecordedOscillation

from tests.simulated import samples

MASS = 0.14  # [kg]
RATE = 500.0  # [Hz]


def recorded(
    model, theta, sines, *, seconds=10.0, depth=4e-3, seed=None, delay=0.0, compliance=0.0, name="run", **known
):
    """A recording of sines {Hz: m} around a depth [m]; noise with a seed only; the force late by `delay` [s]."""
    time = np.arange(int(seconds * RATE)) / RATE
    omega = 2 * np.pi * np.array(list(sines))
    amplitude = np.array(list(sines.values()))

    def motion(t):
        phase = np.outer(t, omega) + 0.3 + np.arange(len(omega))
        return (
            depth + np.sin(phase) @ amplitude,
            np.cos(phase) @ (amplitude * omega),
            -np.sin(phase) @ (amplitude * omega**2),
        )

    def force_at(t):
        d, v, a = motion(t)
        if model.memory:
            before = np.arange(-3.0, t[0], 1 / RATE)
            whole = np.concatenate([before, t])
            d_all, v_all, _ = motion(whole)
            contact = force_over_time(model, whole, d_all, v_all, theta)[len(before) :]
        else:
            contact = contact_force(model, d, v, theta)
        return contact + MASS * a

    return made(model, time, motion(time)[0], force_at(time - delay), seed, compliance, name, **known)


def made(model, time, depth, force, seed=None, compliance=0.0, name="run", **known):
    """A recording of a depth of the tip (n,) [m] and a force of the sensor (n,) [N]."""
    random = np.random.default_rng(seed)
    arm = depth + compliance * force
    if seed is not None:
        force = force + 0.05 * random.standard_normal(len(time))
        arm = arm + 5e-6 * random.standard_normal(len(time))
    known = {"surface_std": 0.0, "tip_mass": MASS, "timing": 0.0, **known}
    exact = {"radius": 0.0, "poisson": 0.0, "angle": 0.0, "height": 0.0, "curvature_radius": 0.0}
    return RecordedOscillation(
        name, "dr/ekf", model, time, force, -arm, 0.0, compliance=compliance, uncertainties=exact, **known
    )


def press(model, theta, *, hold=5.0, depth=3e-3, speed=0.01, rate=200.0, seed=None, skin=2e-4, drift=0.0, **known):
    """Samples of air, a ramp, a hold, a fast way back and air again, as `ReplayedSamples`; noise with a seed only."""

    ramp = depth / speed
    time = np.arange(0.0, 2.0 + ramp + hold, 1 / rate)
    knots = np.array([0.0, 1.0, 1.0 + ramp, 1.0 + ramp + hold, 1.05 + ramp + hold, 3.0 + ramp + hold])
    d = np.interp(time, knots, [-1e-3, 0.0, depth, depth, -2e-3, -2e-3])
    force = force_over_time(model, time, d, np.gradient(d, time), theta, pulls=False)
    return samples_of(model, time, d, force, seed, skin, drift, known)


def samples_of(model, time, d, force, seed, skin, drift, known):
    """The same from any depth and force over time."""
    from dataclasses import replace

    from palpate_engine import UncertainValue
    from palpate_spectra.recorded_oscillation import ReplayedSamples

    whole = samples(time, d, force + drift * time / time[-1], seed, surface=skin)
    contact = (d > 0) & (force > 0)
    whole = replace(whole, contact=contact, active=contact)
    rig = {"tip_mass": 0.0, "tip_mass_std": 0.0, "compliance": 0.0, "compliance_std": 0.0, "timing": 0.0, **known}
    exact = {"radius": 0.0, "poisson": 0.0}
    return ReplayedSamples("t", model, whole, UncertainValue(skin, 1e-5, "m"), rig, exact, ())
