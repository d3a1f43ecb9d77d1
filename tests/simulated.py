"""What tests and benchmarks simulate with the rig's noise: samples of a motion, and a pipeline file of a press."""

import numpy as np
from palpate import Samples

FORCE, POSITION = 0.05, 5e-6  # [N], [m] noise


def samples(time, depth, force, seed, *, surface=1e-4, force_std=FORCE, position_std=POSITION):
    """What a rig says of a depth (n,) [m] under a surface [m] and a force (n,) [N]; seed None: without noise."""
    random = np.random.default_rng(seed)
    noise = (0.0, 0.0) if seed is None else (random.standard_normal(len(time)), random.standard_normal(len(time)))
    height = surface - depth + position_std * noise[1]
    contact, stamps = depth > 0, np.rint(1e9 * time).astype(np.int64)
    steps, noisy = np.diff(time, prepend=0.0), force + force_std * noise[0]
    return Samples(stamps, time, steps, noisy, height, np.gradient(height, time), contact, contact)


def smooth_step(x):
    """From 0 to 1 (n,), at rest at both ends."""
    s = np.clip(x, 0, 1)
    return s**2 * (3 - 2 * s)


def press_and_sines(end=8.0, begin=4.0, share=1.0, step=4e-3):
    """Time [s] and depth [m] (n,): air, a press to 3 mm, a hold, and sines of 1 and 5 Hz, in contact to the end."""
    t = np.arange(0, end, step)
    swing = 0.5e-3 * np.sin(2 * np.pi * (t - begin)) + 0.3e-3 * np.sin(10 * np.pi * (t - begin))
    return t, -0.5e-3 + 3.5e-3 * smooth_step(t / 0.4) + share * smooth_step((t - begin) / 0.5) * swing


def triangle(step=4e-3):
    """Time [s] and depth [m] (n,): in and out once, from air to air, without corners."""
    t = np.arange(0, 2.2, step)
    depth = 3e-3 * np.clip(1 - np.abs(t - 1.1) / 0.8, -0.1, 1)
    return t, np.convolve(np.pad(depth, 10, "edge"), np.ones(21) / 21, "valid")


def pipeline(specimen, trajectory, estimator, *, seed=None, alignment=""):
    """A pipeline file: a sphere of 5 mm on the simulated rig, and one track `sls/fit` of a standard linear solid."""
    run = "" if seed is None else f"[run]\nseed = {seed}\n"
    return f"""{run}
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
{specimen}
[trajectory.press]
{trajectory}
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = {{ channel = "rig.tip.z", uncertainty = "0.1 ms" }}
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
{alignment}
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.sls]
type = "standard-linear-solid"
indenter = "tip"
[estimator.fit]
{estimator}
"""


def solid(elasticity, relaxing, time, more=""):
    """A specimen's lines: a standard linear solid."""
    return (
        f'model = "sls"\nelasticity = "{elasticity}"\nrelaxing_elasticity = "{relaxing}"\n'
        f'relaxation_time = "{time}"\n{more}'
    )
