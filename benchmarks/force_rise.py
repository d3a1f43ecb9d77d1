"""Sound and saturated rigs before the detector of a force that does not rise: false stops, and forces reached.

``python benchmarks/force_rise.py 1000 [first seed]``: so many sound rigs, each drawn from its seed, feed
`palpate_engine.RiseWatch` and `TouchWatch`, as the servo process does; then each again with a sensor that saturates, at
a level of its own and with noise on top. Sound are materials of 1 kPa to 5 MPa that relax or not, under a flat end, a
sphere or a cone, sensors coarse or fine with 5 to 50 mN of noise, white or filtered, the inertia of the tip, motions of
quintic approaches, sines and ramps with holds.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from palpate_engine import RiseWatch, SoundForce, TouchWatch

_TICK = 0.002  # [s]
_RADIUS = 5e-3  # [m]
_CLEARANCE = 3e-3  # [m]
_REACTION = 0.08  # [s] of the rule of overshoot
_RATES = (500.0, 800.0, 1000.0)  # [Hz]


@dataclass(frozen=True)
class SoundRig:
    """Readings of a rig, and where its tip was."""

    time: np.ndarray  # (n,) [s] of each reading
    force: np.ndarray  # (n,) [N] on the skin
    height: np.ndarray  # (n,) [m]
    reading: np.ndarray  # (n,) [N]
    standstill: np.ndarray  # (m,) [N]
    noise: float  # [N]
    resolution: float  # [N]
    mass: float  # [kg]
    acceleration: float  # [m/s^2] largest
    position_std: float  # [m]
    stop: float  # [N]
    room: float  # [N] from there to the force that must not be exceeded
    seed: int

    @property
    def sound(self) -> SoundForce:
        """What its standstill shows; the stiffness is declared as the stiffest of the motion."""
        rng = np.random.default_rng(self.seed + 1)
        window = self.room / (2.0 * self.stiffness)
        position = self.position_std * rng.standard_normal(200)
        sound = SoundForce.of("force", self.standstill, position, window, self.mass * self.acceleration)
        zero_std = sound.standard_error(len(self.standstill))
        return replace(sound, stiffness=self.stiffness, zero_std=zero_std)

    @property
    def stiffness(self) -> float:
        """The largest on the way in [N/m]."""
        inwards = np.diff(self.height) < -1e-9
        return float(max((np.diff(self.force)[inwards] / -np.diff(self.height)[inwards]).max(initial=0.0), 10.0))


def _quintic(time: np.ndarray, begin: float, end: float, way: float) -> np.ndarray:
    t = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return way * (10 * t**3 - 15 * t**4 + 6 * t**5)


def _motion(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Depth (n,) [m] below the skin, negative above it."""
    depth = float(rng.uniform(0.5e-3, 5e-3))
    lasts = float(rng.uniform(0.4, 4.0))
    down = _quintic(time, 0.2, 0.2 + lasts, _CLEARANCE + depth)
    kind = rng.choice(["quintic", "sine", "stairs", "ramp"])
    rest = time - 0.2 - lasts
    if kind == "sine":
        swing, frequency = float(rng.uniform(0.1, 0.9)) * min(depth, 1e-3), float(rng.choice([0.5, 1.0, 2.0, 5.0]))
        down += np.where(rest > 0, swing * np.sin(2 * np.pi * frequency * np.maximum(rest, 0.0)), 0.0)
    elif kind == "stairs":
        for step in range(3):
            down += _quintic(rest, 0.5 + 0.8 * step, 0.8 + 0.8 * step, 0.3 * depth)
    elif kind == "ramp":  # at constant speed, down and up
        speed = float(rng.uniform(0.5e-3, 12e-3))
        turn = (_CLEARANCE + depth) / speed
        down = np.minimum(speed * time, np.maximum(2.0 * speed * turn - speed * time, 0.0))
    return down - _CLEARANCE


def _contact(depth: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
    """Force (n,) [N] of a material that relaxes or not."""
    n = float(rng.choice([1.0, 1.5, 2.0]))
    elasticity = float(np.exp(rng.uniform(np.log(1e3), np.log(5e6))))
    scale = 16 / 9 * elasticity * _RADIUS**0.5 * 1e-3**1.5 / 1e-3**n  # as stiff as a sphere at 1 mm
    pressed = np.maximum(depth, 0.0)
    elastic = scale * pressed**n
    force = elastic.copy()
    if rng.random() < 0.5:  # a standard solid: the share that relaxes follows with a time constant
        share, tau = float(rng.uniform(0.1, 0.8)), float(np.exp(rng.uniform(np.log(0.03), np.log(10.0))))
        relaxed, state = np.exp(-step / tau), 0.0
        held = np.empty_like(elastic)
        for k, change in enumerate(np.diff(elastic, prepend=0.0)):
            state = relaxed * state + share * change
            held[k] = state
        force = (1.0 - share) * elastic + held
    elif rng.random() < 0.5:  # Kelvin-Voigt
        delay = float(rng.uniform(0.0, 0.03))
        force = elastic + delay * n * scale * np.maximum(pressed, 1e-9) ** (n - 1) * np.gradient(pressed, step)
    return np.where(depth > 0, np.maximum(force, 0.0), 0.0)


def drawn(seed: int, is_whole: bool = False) -> SoundRig:
    """A sound rig, up to the force that stops it, or with the whole of its motion."""
    rng = np.random.default_rng(seed)
    rate = float(rng.choice(_RATES))
    time = np.arange(0.0, 7.0, 1.0 / rate)
    depth = _motion(time, rng)
    force = _contact(depth, 1.0 / rate, rng)
    stop = float(rng.uniform(5.0, 15.0))
    over = np.flatnonzero(force > stop)
    last = int(over[0]) if len(over) and not is_whole else len(time)
    mass, noise = float(rng.uniform(0.0, 0.2)), float(rng.uniform(0.005, 0.05))
    acceleration = -np.gradient(np.gradient(depth, time), time)
    resolution = float(rng.choice([1e-4, 1e-3, 0.01, 0.05]))
    random = rng.standard_normal(len(time) + 1000)
    if rng.random() < 0.5:  # a filter's
        random = np.convolve(random, np.full(4, 0.5), "same")
    standstill, moving = noise * random[:1000], noise * random[1000:]
    round_ = lambda values: np.rint(values / resolution) * resolution  # noqa: E731
    most = float(np.abs(acceleration[2:-2]).max())
    reading = round_(force + mass * acceleration + moving)
    return SoundRig(
        time[:last], force[:last], -depth[:last], reading[:last], round_(standstill),
        noise, resolution, mass, most, float(rng.uniform(1e-6, 1e-5)), stop, 8.0, seed,
    )  # fmt: skip


def saturated(rig: SoundRig) -> SoundRig:
    """The same with a sensor that ends at a level, and noise on top of it; only the detector stops the motion."""
    rng = np.random.default_rng(rig.seed + 2)
    level = float(rng.uniform(0.2, 0.9)) * min(rig.stop, float(rig.force.max(initial=0.0)))
    clipped = np.minimum(rig.force, level) + rig.noise * rng.standard_normal(len(rig.force))
    reading = np.rint(clipped / rig.resolution) * rig.resolution
    return SoundRig(**{**vars(rig), "reading": reading})


def stopped(rig: SoundRig) -> tuple[float, str] | None:
    """When [s] and why the detector stops a rig; None where it does not."""
    watch, rng = RiseWatch(rig.sound), np.random.default_rng(rig.seed + 3)
    touch = TouchWatch(rig.sound, watch.contact, 0.0)
    height = rig.height + rig.position_std * rng.standard_normal(len(rig.height))
    edges = np.searchsorted(rig.time, np.arange(0.0, rig.time[-1] + _TICK, _TICK)).tolist()
    for first, last in pairwise(edges):
        if first == last:
            continue
        tip = float(height[last - 1])
        look = float(rig.time[last - 1]), rig.reading[first:last], -tip, (0.0, 0.0, tip)
        text = watch.add(*look) or touch.fault(*look, tip >= 0.8 * _CLEARANCE)
        if text is not None:
            return float(rig.time[last - 1]), text
    return None


def main() -> None:
    """The false stops, and what of the saturated ones is found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("first", type=int, nargs="?", default=0)
    given = parser.parse_args()
    rigs = [rig for rig in map(drawn, range(given.first, given.first + given.count)) if len(rig.time) > 1]
    false = [(rig.seed, found) for rig in rigs if (found := stopped(rig)) is not None]
    print(f"sound: {len(rigs)}, stopped: {len(false)}")
    for seed, (time, text) in false:
        print(f"  seed {seed} at {time:.2f} s: {text}")
    dangerous = found = 0
    beyond = []
    for rig in map(saturated, rigs):
        level = float(rig.reading.max(initial=0.0))
        speed = float(-np.diff(rig.height).min(initial=0.0) / (rig.time[1] - rig.time[0]))
        if rig.force.max(initial=0.0) < level + rig.room or rig.stiffness * speed * _REACTION > rig.room:
            continue  # no harm, or a motion that is refused
        dangerous += 1
        end = stopped(rig)
        found += end is not None
        until = rig.force[rig.time <= end[0]] if end is not None else rig.force
        beyond.append(float(until.max()) - level)
    print(
        f"saturated, and pressed 8 N harder than is read: {dangerous}, stopped: {found}; force beyond the level, N: ",
        end="",
    )
    print(", ".join(f"{np.quantile(beyond, q):.1f} ({100 * q:.0f} %)" for q in (0.5, 0.9, 1.0)) if beyond else "none")


if __name__ == "__main__":
    main()
