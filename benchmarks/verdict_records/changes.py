"""What is changed in depths and forces by what is wrong with a record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from verdict_records.contact import Specimen
from verdict_records.rigs import Column

Change = Callable[[Specimen, float, Column, Column], Column]  # specimen, size, depth, force (m,) -> what it makes of it


def relaxing(s: Specimen, elastic: Column, tau: float) -> Column:
    """q' = f' - q/tau, exact for steps of constant f'."""
    keep = np.exp(-s.step / tau)
    return np.asarray(lfilter([(1 - keep) * tau / s.step], [1.0, -keep], np.diff(elastic, prepend=elastic[0])))


def memory(*taus: float) -> Change:
    """Maxwell branches in parallel with the spring, x of it together."""
    return lambda s, x, d, f: f + x * sum(relaxing(s, f, tau) for tau in taus) / len(taus)


def part_of(s: Specimen, d: Column) -> Column:
    """Depth over the largest."""
    return np.asarray(np.maximum(d, 0.0) / np.max(d))


def bonded_layer(s: Specimen, x: float, d: Column, f: Column) -> Column:
    """Dimitriadis et al. 2002, eq. 13, X = x at the largest contact radius."""
    y = x * s.radius(d) / np.max(s.radius(d))
    return np.asarray(f * (1 + 1.133 * y + 1.283 * y**2 + 0.769 * y**3 + 0.0975 * y**4))


def since(s: Specimen, d: Column) -> Column:
    """[s] since the first touch."""
    return np.maximum(s.time - s.time[int(np.argmax(d > 0))], 0.0)


def middle(s: Specimen, d: Column) -> float:
    """[s] the middle of the contact."""
    touched = s.time[d > 0]
    return float(0.5 * (touched[0] + touched[-1]))


def step_at(s: Specimen, x: float, d: Column, at: float = 0.0) -> Column:
    """A step of x in the middle of the contact."""
    return np.where(s.time > middle(s, d) + at, x, 0.0)


def smooth_rise(s: Specimen, d: Column) -> Column:
    """From 0 to 1 over the middle third of the contact."""
    touched = s.time[d > 0]
    part = np.clip((s.time - touched[0]) / (touched[-1] - touched[0]) * 3 - 1, 0, 1)
    return np.asarray(3 * part**2 - 2 * part**3)


def play(x: float, depth: Column) -> Column:
    """The play operator: follows a depth once it has gone by x the other way."""
    found, place = np.empty(len(depth)), float(depth[0])
    for i, value in enumerate(depth.tolist()):
        place = min(max(place, value - x), value + x)
        found[i] = place
    return found


def base_way(s: Specimen, x: float, d: Column, f: Column) -> Column:
    """A base of x [m/N]: d - x F(d)."""
    low, high, rate = np.zeros(len(d)), np.maximum(d, 0.0), s.rate_of(d)
    for _ in range(45):
        mid = 0.5 * (low + high)
        too_deep = mid + x * np.maximum(s.elastic(mid) + s.viscous(mid, rate), 0.0) > d
        low, high = np.where(too_deep, low, mid), np.where(too_deep, mid, high)
    return np.where(d > 0, high, d)


def high_pass(s: Specimen, x: float, d: Column, f: Column) -> Column:
    """A first-order high-pass of x [Hz]."""
    keep = np.exp(-2 * np.pi * x * s.step)
    return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], f))


def low_pass(s: Specimen, values: Column, tau: float) -> Column:
    """A first-order low-pass of a time [s]."""
    keep = np.exp(-s.step / max(tau, 1e-9))
    return np.asarray(lfilter([1 - keep], [1.0, -keep], values - values[0]) + values[0])


def frozen(s: Specimen, x: float, d: Column, f: Column) -> Column:
    """A force that repeats one reading for x [s] on the way in."""
    begin = int(np.argmax(d > 0.3 * np.max(d)))
    return np.where((s.time >= s.time[begin]) & (s.time < s.time[begin] + x), f[begin], f)


def spikes(s: Specimen, x: float, d: Column, f: Column) -> Column:
    """One reading in 250 is off by x."""
    rows = np.random.default_rng(7).random(len(f)) < 0.004
    return f + np.where(np.repeat(rows[::4], 4)[: len(f)], x, 0.0)
