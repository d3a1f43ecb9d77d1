"""Presses of a paraboloid on a half-space, as tables of an indenter: the tip at rest, down, up, at rest."""

import numpy as np

ELASTICITY, VISCOSITY, RADIUS = 25e3, 60.0, 6.35e-3  # [Pa], [Pa s], [m]
NOISE, HEIGHT_NOISE = 2.8e-3, 0.5e-6  # [N], [m]
RIG = {
    "tip": "paraboloid 6.35 mm", "thickness": "half-space", "delay": "0 ms +- 0.2 ms", "tip-mass": "0 g",
    "tare": "free-air 0.9 s", "poisson": "0.5 +- 0.0001", "inclination": "0 deg", "mount": "100 kN/mm",
    "position-of": "tip",
}  # fmt: skip


def press(seed, rest, deepest=-2.5e-3, viscosity=VISCOSITY, rate=200.0):
    """Time [s], force [N] and height [m] (n,): 1 s at rest at a height [m], 3 s down, 3 s up, 1 s at rest."""
    random = np.random.default_rng(seed)
    time = np.arange(int(8.0 * rate)) / rate
    height = np.interp(time, [1.0, 4.0, 7.0], [rest, deepest, rest])
    speed = np.where((time > 1.0) & (time < 7.0), np.sign(4.0 - time), 0.0) * (rest - deepest) / 3.0
    depth = np.maximum(-height, 0.0)
    force = 16.0 / 9.0 * ELASTICITY * np.sqrt(RADIUS) * depth**1.5 + 8.0 * viscosity * np.sqrt(RADIUS * depth) * speed
    noise = NOISE * random.standard_normal(len(time)), HEIGHT_NOISE * random.standard_normal(len(time))
    return time, force + noise[0], height + noise[1]


def sticking_press(seed, work, start=0.5e-3, deepest=-1.5e-3, rate=200.0):
    """The same press of an elastic material that sticks with a work of adhesion [J/m^2] (Johnson, Kendall, Roberts)."""
    random = np.random.default_rng(seed)
    time = np.arange(int(8.0 * rate)) / rate
    height = np.interp(time, [1.0, 4.0, 7.0], [start, deepest, start])
    stiffness, radius = ELASTICITY / 0.75, np.linspace(1e-6, 8e-3, 100_000)
    depth = radius**2 / RADIUS - np.sqrt(2.0 * np.pi * work * radius / stiffness)
    force = 4.0 * stiffness * radius**3 / (3.0 * RADIUS) - np.sqrt(8.0 * np.pi * work * stiffness * radius**3)
    # It sticks at depth 0, and lets go where the branch ends.
    branch = int(np.argmin(depth))
    touched = int(np.argmax(height <= 0.0))
    sticks = (np.arange(len(time)) >= touched) & ((time < 4.0) | (-height > depth[branch]))
    pushed = np.where(sticks, np.interp(-height, depth[branch:], force[branch:]), 0.0)
    noise = NOISE * random.standard_normal(len(time)), HEIGHT_NOISE * random.standard_normal(len(time))
    return time, pushed + noise[0], height + noise[1]


def zeroed_press(seed, rest, **others):
    """A press whose force is zeroed while the tip rests."""
    time, force, height = press(seed, rest, **others)
    return time, force - force[time < 0.9].mean(), height


def write_press(path, columns):
    """A table of a press."""
    table = np.column_stack([*columns[:2], 1e3 * columns[2]])
    np.savetxt(path, table, fmt="%.7f", delimiter=",", header="time (s),force (N),height (mm)", comments="")
    return path


def facts(**others):
    """Options of `palpate fit` that state a whole rig."""
    return [word for name, value in {**RIG, **others}.items() for word in (f"--{name}", value)]
