"""Simulated palpations whose material, tip, timing or sensor is not what the model says.

Every force is written out here, on numbers, from the literature's formulas: nothing is taken from the product, so that
an error there cannot hide in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats, Samples

RATE = 500.0  # [Hz]
AIR, APPROACH = 1.0, 1.0  # [s]
KINDS = (
    "thickness",
    "memory",
    "power-law",
    "timing",
    "lift-off",
    "another tip",
    "drift",
    "stiffening",
)


@dataclass(frozen=True)
class Palpation:
    """A point palpation: a sine around a depth, under a sphere that pushes into an incompressible material."""

    elasticity: float = 282.1e3  # [Pa]
    viscosity: float = 800.0  # [Pa s]
    radius: float = 5e-3  # [m]
    depth: float = 4e-3  # [m]
    amplitude: float = 1e-3  # [m]
    frequency: float = 2.0  # [Hz]
    duration: float = 10.0  # [s]
    mass: float = 0.14  # [kg] behind the sensor
    force_noise: float = 0.05  # [N]
    colour: float = 0.0  # correlation of the force's noise from sample to sample
    position_noise: float = 5e-6  # [m]
    velocity_noise: float = 0.67e-3  # [m/s]
    phase: float = 0.0  # [rad] at the start of the sine
    height: float = 22e-3  # [m] of the layer, "thickness"
    share: float = 0.3  # of the force that relaxes, "memory"
    relaxation: float = 0.3  # [s], "memory"
    late: float = 6e-3  # [s], "timing"
    slope: float = 0.05  # [N/s], "drift"


S2 = Palpation(elasticity=112.5e3, viscosity=362.0)


def record(palpation: Palpation, kind: str = "clean", seed: int = 0) -> Samples:
    """Samples of a palpation of one of KINDS, or of a clean one."""
    p = palpation
    if kind == "lift-off":  # the tip leaves faster than the material recovers
        p = replace(p, depth=1.5e-3, amplitude=1.4e-3, frequency=5.0, viscosity=5 * p.viscosity)
    random = np.random.default_rng(seed)
    fine = 4  # steps for each sample, for what relaxes
    time = np.arange(round((AIR + APPROACH + p.duration) * RATE * fine)) / (RATE * fine)
    depth, rate, acceleration = _motion(p, time, lines=3 if kind == "timing" else 1)
    force = _force(p, kind, time, depth, rate)
    if kind == "timing":  # a first-order low-pass and nothing else
        force = _lagged(force, 1.0 / (RATE * fine), p.late)
    force = force + p.mass * acceleration  # the sensor moves the tip, too
    time, depth, rate, force = (column[::fine] for column in (time, depth, rate, force))
    if kind == "drift":
        force = force + p.slope * time
    n = len(time)
    force = force + _noise(random, n, p.force_noise, p.colour)
    position = -depth + p.position_noise * random.standard_normal(n)
    velocity = -rate + p.velocity_noise * random.standard_normal(n)
    contact = np.convolve(force > 0.25, np.ones(3), "full")[:n] > 2.5
    touched = np.maximum.accumulate(contact)
    if kind != "lift-off":
        contact = touched
    active = contact & (time >= AIR + APPROACH)
    stamp = np.round(time * 1e9).astype(np.int64)
    interval = np.diff(time, prepend=time[0])
    return Samples(stamp, time, interval, force, position, velocity, contact, active)


def _motion(p: Palpation, time: Floats, lines: int) -> tuple[Floats, Floats, Floats]:
    """Depth, its rate and acceleration: at rest 2 mm above, down along a smooth step, then sines."""
    start = p.depth + p.amplitude * np.sin(p.phase)
    s = np.clip((time - AIR) / APPROACH, 0.0, 1.0)
    way = start + 2e-3
    depth = -2e-3 + way * s**3 * (10 - 15 * s + 6 * s**2)
    rate = way / APPROACH * 30 * s**2 * (1 - s) ** 2
    acceleration = way / APPROACH**2 * 60 * s * (1 - s) * (1 - 2 * s)
    t, moving = time - AIR - APPROACH, time >= AIR + APPROACH
    depth[moving], rate[moving], acceleration[moving] = p.depth, 0.0, 0.0
    for line in range(lines):  # one sine, or several of which none is a harmonic of the first
        w, size = 2 * np.pi * p.frequency * 2.3**line, p.amplitude / lines
        sine = (w * t + p.phase)[moving]
        depth[moving] += size * np.sin(sine)
        rate[moving] += size * w * np.cos(sine)
        acceleration[moving] -= size * w**2 * np.sin(sine)
    return depth, rate, acceleration


def _force(p: Palpation, kind: str, time: Floats, depth: Floats, rate: Floats) -> Floats:
    d = np.maximum(depth, 0.0)
    inside = depth > 0
    hertz = 16.0 / 9.0 * p.elasticity * np.sqrt(p.radius) * d**1.5  # 4/3 E/(1 - 0.25) sqrt(R) d^1.5
    dashpot = 8.0 * p.viscosity * np.sqrt(p.radius * d) * rate * inside
    step = float(time[1] - time[0])
    match kind:
        case "thickness":  # Dimitriadis et al. 2002, eq. 13, bonded; its derivative for the dashpot
            x = np.sqrt(p.radius * d) / p.height
            return hertz * _layer(x) + dashpot * (_layer(x) + x / 3.0 * _layer_slope(x))
        case "memory":  # a Maxwell branch in parallel with the spring: the force relaxes to what the spring holds
            branch = _relaxing(p.share * hertz, step, p.relaxation)
            return hertz + branch + dashpot
        case "power-law":  # ten branches, one a third of a decade: a loss angle that hardly depends on frequency
            times = 10.0 ** np.arange(-2.0, 1.01, 1.0 / 3.0)
            return hertz + sum(_relaxing(0.06 * hertz, step, t) for t in times)
        case "lift-off":  # the surface does not pull: it comes back slower than the tip leaves
            return np.maximum(hertz + dashpot, 0.0)
        case "another tip":  # a cone of the same force at the mean depth
            return hertz * np.sqrt(d / p.depth) + dashpot
        case "stiffening":  # strain hardening
            return hertz * (1.0 + 0.5 * d / p.radius) + dashpot
        case _:
            return hertz + dashpot


def _layer(x: Floats) -> Floats:
    return np.asarray(1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4)


def _layer_slope(x: Floats) -> Floats:
    return np.asarray(1.133 + 2.566 * x + 2.307 * x**2 + 0.39 * x**3)


def _relaxing(force: Floats, step: float, time: float) -> Floats:
    """The part of a force that dies away with a time constant: q' = f' - q/tau, exact for steps of constant f'."""
    from scipy.signal import lfilter

    keep = np.exp(-step / time)
    change = np.diff(force, prepend=force[0])
    return np.asarray(lfilter([(1 - keep) * time / step], [1.0, -keep], change))


def _lagged(force: Floats, step: float, time: float) -> Floats:
    from scipy.signal import lfilter

    keep = np.exp(-step / time)
    return np.asarray(lfilter([1 - keep], [1.0, -keep], force))


def _noise(random: np.random.Generator, n: int, std: float, colour: float) -> Floats:
    white = random.standard_normal(n)
    if colour:
        from scipy.signal import lfilter

        start = random.standard_normal()
        white = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white, zi=[colour * start])[0]
    return std * np.asarray(white)
