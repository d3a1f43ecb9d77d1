"""What the tip does against the surface, and what the encoders say of it."""

from __future__ import annotations

import numpy as np
from palpate import Floats

from laboratory.palpation import Palpation

RATE = 500.0  # [Hz] of the log
FINE = 4  # steps for each row of it
STEP = 1.0 / (RATE * FINE)  # [s]
AIR, WAY, REST = 1.0, 1.0, 0.5  # [s] at rest above, of approach and retraction each, at rest at the end


def sine_span(p: Palpation) -> tuple[float, float]:
    """Beginning and end [s] of the sine, 10 s and half a period, so that it ends on the way out."""
    begin = AIR + WAY
    return begin, begin + 10.0 + p.wait + 0.5 / p.frequency


def instants(p: Palpation) -> Floats:
    """Fine instants (n,) [s] of the whole record."""
    return np.arange(round((sine_span(p)[1] + WAY + REST) / STEP)) * STEP


def command(p: Palpation, time: Floats) -> Floats:
    """Depth (n,) [m] that the robot is to go to: quintic ways that meet the sine at full speed where it is centred."""
    begin, end = sine_span(p)
    pace = 2 * np.pi * p.frequency
    depth = np.full(len(time), p.start_depth)
    way_in = (time >= AIR) & (time < begin)
    depth[way_in] = _quintic(time[way_in] - AIR, (p.start_depth, 0.0), (p.depth, p.amplitude * pace))
    sine = (time >= begin) & (time < end)
    since = time[sine] - begin
    if p.wait:  # at a turning point, in the middle
        stop = (round(5.0 * p.frequency) + 0.25) / p.frequency
        since = np.where(since < stop, since, np.maximum(since - p.wait, stop))
    depth[sine] = p.depth + p.amplitude * np.sin(pace * since)
    way_out = (time >= end) & (time < end + WAY)
    depth[way_out] = _quintic(time[way_out] - end, (p.depth, -p.amplitude * pace), (-2e-3, 0.0))
    depth[time >= end + WAY] = -2e-3
    return depth


def _quintic(time: Floats, start: tuple[float, float], end: tuple[float, float]) -> Floats:
    """From place and speed to place and speed in `WAY`, without acceleration at either end."""
    s, (p0, v0), (p1, v1) = time / WAY, start, end
    v0, v1 = v0 * WAY, v1 * WAY
    way = p1 - p0
    cubic = 10 * way - 6 * v0 - 4 * v1, -15 * way + 8 * v0 + 7 * v1, 6 * way - 3 * (v0 + v1)
    return np.asarray(p0 + v0 * s + s**3 * (cubic[0] + cubic[1] * s + cubic[2] * s**2))


def surface(p: Palpation, time: Floats, tip: Floats) -> Floats:
    """How far (n,) [m] the surface is below its place, against a tip at depths (n,) [m]."""
    begin, end = sine_span(p)
    progress = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    middle = 0.5 * (begin + end)
    sunk = -p.swelling * progress + p.creep * (1 - np.exp(-np.maximum(time - begin, 0.0) / 3.0))
    sunk += p.slip * (time >= middle)
    size, rate = p.breathing
    sunk += size * np.sin(2 * np.pi * rate * time) - (size * np.sin(2 * np.pi * rate * begin) if size else 0.0)
    if p.slide:
        sunk += play(tip, p.slide)
    return np.asarray(sunk)


def unseen(p: Palpation, time: Floats) -> Floats:
    """How far (n,) [m] the tip is below the place that the encoders give."""
    begin, end = sine_span(p)
    middle = 0.5 * (begin + end) + 0.07
    since = np.maximum(time - middle, 0.0)
    moved = p.tremor[0] * np.sin(2 * np.pi * p.tremor[1] * time)
    moved += p.bump * np.exp(-since / 0.1) * np.sin(2 * np.pi * 15.0 * since)
    moved += p.thermal * np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return np.asarray(moved)


def play(way: Floats, width: float) -> Floats:
    """What a play of a width takes from a way (n,): the way less that of what is moved (Prandtl's operator)."""
    left, moved = np.empty(len(way)), float(way[0])
    for i, place in enumerate(way.tolist()):
        moved = min(max(moved, place - width / 2), place + width / 2)
        left[i] = place - moved
    return left
