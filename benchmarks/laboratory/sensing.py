"""What sensor, robot and log make of a palpation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

from laboratory.contact import contact_force
from laboratory.motion import FINE, RATE, STEP, command, instants, play, sine_span, surface, unseen
from laboratory.palpation import Palpation


@dataclass(frozen=True)
class Log:
    """Rows of a log (n,): stamp [s], force [N], height [m], its velocity [m/s], 1 while the motion is measured."""

    stamp: Floats
    force: Floats
    height: Floats
    velocity: Floats
    measuring: Floats


def make_log(p: Palpation, seed: int, noise: bool = True) -> Log:
    """The log of a palpation; without noise what its mean is."""
    random = np.random.default_rng(seed)
    time = instants(p)
    way = command(p, time)
    tip = way + unseen(p, time) - (play(way, p.backlash) if p.backlash else 0.0)
    depth = tip - surface(p, time, tip)
    acceleration = np.gradient(np.gradient(tip, STEP), STEP)
    force = contact_force(p, time, depth) + p.tip_mass * acceleration
    speed = np.gradient(tip, STEP)
    force = force + p.cable * tip + p.guide * np.tanh(speed / 1e-4) + p.pickup * speed
    force = _sensed(p, time, force)
    said, rate = _encoded(p, time, way)
    force = _late(time, force, p.force_late)
    if p.clock:
        force = np.interp(time * (1 + p.clock), time, force)
    rate = _late(time, rate, p.velocity_late)
    rows = slice(None, None, FINE)
    return _logged(p, random, time[rows], force[rows], said[rows], rate[rows], noise)


def _sensed(p: Palpation, time: Floats, force: Floats) -> Floats:
    """What the sensor makes of a force (n,) [N], before its noise."""
    begin, end = sine_span(p)
    since = np.maximum(time - begin, 0.0)
    if p.ringing is not None:
        force = _rung(force, *p.ringing)
    if p.play:
        force = force - play(force, p.play)
    force = p.gain * force * (1 + p.curve * force / 5.0)
    size, rate, phase = p.tone
    force = force + size * np.sin(2 * np.pi * rate * (time - begin) + phase)
    force = force + p.zero_step * (time >= 0.5 * (begin + end)) + p.zero_drift * time
    force = force + p.warm_up * (1 - np.exp(-since / 5.0))
    if p.coupling is not None:
        force = force - _low_pass(force, p.coupling)
    return _low_pass(force, p.low_pass) if p.low_pass is not None else force


def _low_pass(values: Floats, frequency: float) -> Floats:
    from scipy.signal import lfilter

    keep = np.exp(-2 * np.pi * frequency * STEP)
    return np.asarray(lfilter([1 - keep], [1.0, -keep], values, zi=[keep * values[0]])[0])


def _rung(force: Floats, frequency: float, damping: float) -> Floats:
    """A force through a second-order resonance, by the exact map of its state for held forces."""
    from scipy.signal import cont2discrete, lfilter

    w = 2 * np.pi * frequency
    (top,), bottom, _ = cont2discrete(([w**2], [1.0, 2 * damping * w, w**2]), STEP, "zoh")
    return np.asarray(lfilter(top, bottom, force))


def _encoded(p: Palpation, time: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Height (n,) [m] that the robot gives, and velocity (n,) [m/s], before their noise."""
    lead = p.commanded or -p.position_late
    if lead:
        way = np.interp(time + lead, time, way)
    height = -way
    height = p.height_gain * height + p.height_curve * np.sin(2 * np.pi * height / 1e-3)
    return height, np.gradient(height, STEP)


def _late(time: Floats, values: Floats, late: float) -> Floats:
    return np.interp(time - late, time, values) if late else values


def _mean(values: Floats, count: int) -> Floats:
    """Mean of the latest so many values."""
    sums = np.cumsum(np.concatenate([np.full(count, values[0]), values]))
    return (sums[count:] - sums[:-count]) / count


def _logged(
    p: Palpation, random: np.random.Generator, time: Floats, force: Floats, height: Floats, rate: Floats, noise: bool
) -> Log:
    """Rows with noise, digits and all that happens to rows."""
    n, (begin, end) = len(time), sine_span(p)
    spread = (p.force_noise, p.position_noise, p.velocity_noise) if noise else (0.0, 0.0, 0.0)
    if p.commanded is not None:
        spread = spread[0], 0.0, 0.0
    force = force + spread[0] * _noise(random, n, p.colour)
    height = height + spread[1] * random.standard_normal(n)
    rate = rate + spread[2] * random.standard_normal(n)
    if noise:
        force = force + 2.0 * random.choice((-1.0, 1.0), n) * (random.random(n) < p.spikes)
        force = np.where(random.random(n) < p.zeros, 0.0, force)
    force, height, rate = _mean(force, p.force_mean), _mean(height, p.position_mean), _mean(rate, p.position_mean)
    rate = _mean(rate, p.velocity_mean)
    if p.most is not None:
        force = np.clip(force, -p.most, p.most)
    if p.stuck:
        middle = 0.5 * (begin + end)
        still = (time >= middle) & (time < middle + p.stuck)
        force[still] = force[np.argmax(still)]
    force = force[np.arange(n) // p.held * p.held]
    if noise:
        force, height = _digits(force, p.force_step), _digits(height, p.position_step)
    return _rows(p, random, time, force, height, rate)


def _rows(p: Palpation, random: np.random.Generator, time: Floats, force: Floats, height: Floats, rate: Floats) -> Log:
    """Stamps, and which rows the log has."""
    n, (begin, end) = len(time), sine_span(p)
    stamp = time * (1 + p.rate_error)
    if p.jitter:
        stamp = np.maximum.accumulate(stamp + np.clip(p.jitter * random.standard_normal(n), -0.9e-3, 0.9e-3))
    if p.stamp_step:
        stamp = _digits(stamp, p.stamp_step)
    keep = random.random(n) >= p.lost
    for _ in range(p.gaps):
        start = random.integers(round((begin + 1) * RATE), round(end * RATE))
        keep[start : start + round(random.uniform(0.03, 0.1) * RATE)] = False
    rows = np.repeat(np.flatnonzero(keep), 1 + (random.random(int(keep.sum())) < p.doubled))
    measuring = ((time >= begin) & (time < begin + 10.0 + p.wait)).astype(float)
    units = p.force_unit, p.motion_unit, p.motion_unit * p.velocity_unit
    columns = (force * units[0], height * units[1], rate * units[2], measuring)
    return Log(stamp[rows], *(column[rows] for column in columns))


def _digits(values: Floats, step: float) -> Floats:
    return np.round(values / step) * step if step else values


def _noise(random: np.random.Generator, n: int, colour: float) -> Floats:
    white = random.standard_normal(n)
    if not colour:
        return white
    from scipy.signal import lfilter

    start = random.standard_normal()
    return np.asarray(lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white, zi=[colour * start])[0])
