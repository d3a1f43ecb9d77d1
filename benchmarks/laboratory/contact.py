"""Contact forces by the literature's formulas, on numbers."""

from __future__ import annotations

import numpy as np
from palpate import Floats

from laboratory.motion import STEP, sine_span
from laboratory.palpation import Palpation


def contact_force(p: Palpation, time: Floats, depth: Floats) -> Floats:
    """Force (n,) [N] along the tip's axis at depths (n,) [m], positive where the tip is pushed out."""
    if p.tilt:
        depth = depth * np.cos(p.tilt)
    if p.base is not None or p.glove is not None:
        depth = _yielding(p, depth)
    rate = np.gradient(depth, STEP)
    if p.adhesion:
        force = _jkr(p, depth, rate)
    else:
        elastic, radius = _elastic(p, np.maximum(depth, 0.0))
        elastic = elastic * _ageing(p, time, depth)
        past = sum((_relaxing(share * elastic, tau) for share, tau in p.branches), np.zeros(len(time)))
        force = elastic + past + 4 * p.viscosity / (1 - p.poisson) * radius * rate * (depth > 0)
        force = np.maximum(force, 0.0)  # without adhesion nothing pulls: the tip leaves
    wet = (np.maximum.accumulate(depth) > 0) & (depth > -1e-3)
    force = force + p.liquid * np.maximum(depth + 2e-3, 0.0) + p.drag * rate - p.meniscus * wet
    if p.tilt:  # normal force and friction, which acts against the sliding, along the tip's axis
        force = force * (np.cos(p.tilt) + p.friction * np.sin(p.tilt) * np.sign(rate))
    return np.asarray(force)


def _modulus(p: Palpation) -> float:
    return p.elasticity / (1 - p.poisson**2)


def _elastic(p: Palpation, depth: Floats) -> tuple[Floats, Floats]:
    """Elastic force (n,) [N], and the radius (n,) [m] by which the dashpot acts: dF/dd / 2E* (n,)."""
    step = 1e-7
    low, high = _static(p, depth), _static(p, depth + step)
    return low, np.where(depth > 0, (high - low) / step / (2 * _modulus(p)), 0.0)


def _static(p: Palpation, depth: Floats) -> Floats:
    """Elastic force (n,) [N] of a tip held at depths (n,) [m] of 0 and more."""
    modulus, radius = _modulus(p), p.radius
    if p.curvature is not None:  # Hertz 1882: two spheres
        radius = 1.0 / (1.0 / radius + 1.0 / p.curvature)
    hertz = 4.0 / 3.0 * modulus * np.sqrt(radius) * depth**1.5
    if p.tip == "flat":  # Boussinesq 1885
        return 2.0 * modulus * p.radius * depth
    if p.tip == "cone":  # Love 1939, its angle such that it pushes as the sphere does at the mean depth
        return hertz * np.sqrt(depth / p.depth)
    if p.tip == "exact-sphere":
        return _exact_sphere(modulus, radius, depth)
    if p.fung is not None:
        return _fung(p, depth)
    factor = np.ones(len(depth))
    contact = np.sqrt(radius * depth)
    if p.height is not None:  # Dimitriadis et al. 2002, eq. 13
        x = contact / p.height
        factor = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
    if p.skin is not None:  # Gao, Chiu and Lee 1992, weights by their I_0 of t/a
        thickness, share = p.skin
        x = thickness / np.maximum(contact, 1e-9)
        weight = 2 / np.pi * np.arctan(x) + x / np.pi * np.log1p(x**-2.0)
        factor = 1 + (share - 1) * weight
    if p.lump is not None:
        factor = 1 + p.lump[0] * np.exp((depth - 4e-3) / p.lump[1])
    return np.asarray(hertz * factor * (1 - p.softening_strain * depth / radius))


def _exact_sphere(modulus: float, radius: float, depth: Floats) -> Floats:
    """Sneddon 1965: depth and force over the contact radius, which is found on a table."""
    a = np.linspace(0.0, 0.97 * radius, 4000)
    log = np.log((radius + a) / (radius - a))
    return np.interp(depth, a / 2 * log, modulus * ((a**2 + radius**2) / 2 * log - a * radius))


def _fung(p: Palpation, depth: Floats) -> Floats:
    """Lin, Shreiber, Dimitriadis and Horkay 2009, eq. 24; for a/R that goes to 0 that is Hertz's force."""
    s, b = np.sqrt(depth / p.radius), p.fung or 0.0
    shape = (s**5 - 15 * s**4 + 75 * s**3) / (5 * s**2 - 50 * s + 125)
    size = 4.0 / 3.0 * _modulus(p) * p.radius**2 / 0.6
    return np.asarray(size * shape * np.exp(b * (s**3 - 15 * s**2) / (25 * s - 125)))


def _jkr(p: Palpation, depth: Floats, rate: Floats) -> Floats:
    """Johnson, Kendall and Roberts 1971: touches at depth 0, and comes off where the stable branch ends."""
    modulus, w = _modulus(p), p.adhesion
    least = (np.pi * w * p.radius**2 / (8 * modulus)) ** (1 / 3)  # of the stable branch at a given depth
    a = np.linspace(least, 3 * p.radius, 60000)
    depths = a**2 / p.radius - np.sqrt(2 * np.pi * w * a / modulus)
    forces = 4 * modulus * a**3 / (3 * p.radius) - np.sqrt(8 * np.pi * w * modulus * a**3)
    touched = np.zeros(len(depth), bool)
    holds = False
    for i, place in enumerate(depth.tolist()):
        holds = place > 0 or (holds and place > depths[0])
        touched[i] = holds
    radius = np.interp(depth, depths, a)
    force = np.interp(depth, depths, forces) + 4 * p.viscosity / (1 - p.poisson) * radius * rate
    return np.where(touched, force, 0.0)


def _ageing(p: Palpation, time: Floats, depth: Floats) -> Floats:
    """Factor (n,) of the elastic force as the specimen softens under load, or dries."""
    begin, end = sine_span(p)
    loaded = np.cumsum(depth > 0) * STEP
    progress = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return np.asarray((1 + p.softening * np.expm1(-loaded / 2.0)) * (1 + p.drying * progress))


def _relaxing(force: Floats, time: float) -> Floats:
    """The part of a force that dies away with a time constant: q' = f' - q/tau, exact for steps of constant f'."""
    from scipy.signal import lfilter

    keep = np.exp(-STEP / time)
    change = np.diff(force, prepend=force[0])
    return np.asarray(lfilter([(1 - keep) * time / STEP], [1.0, -keep], change))


def _yielding(p: Palpation, way: Floats) -> Floats:
    """Depth (n,) [m] where base or cover takes a part of the way: k (way - d) = F(d, d'), implicit in each step.

    A base is a linear spring; a cover stiffens as its own contact does, by the square root of its way.
    """
    kappa = 4.0 / 3.0 * _modulus(p) * np.sqrt(p.radius)
    lam = 4 * p.viscosity / (1 - p.poisson) * np.sqrt(p.radius)
    depth, d = np.array(way), 0.0
    mean = p.depth**1.5 * kappa
    power = 1.0 if p.glove is None else 1.5
    stiffness = (p.base or 0.0) if p.glove is None else p.glove * np.sqrt(p.glove / mean)
    for i, place in enumerate(way.tolist()):
        if place <= 0:
            d = 0.0
            continue
        low, high, last = 0.0, place, d
        for _ in range(40):  # bisection: what the spring holds less what the specimen gives falls with the depth
            d = 0.5 * (low + high)
            held = stiffness * (place - d) ** power
            given = kappa * d**1.5 + lam * np.sqrt(d) * (d - last) / STEP
            low, high = (d, high) if held > given else (low, d)
        depth[i] = d
    return depth
