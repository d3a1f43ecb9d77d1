"""Unloading after Ting (1966): in unloading the contact shrinks faster than the depth alone would make it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats

from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.skin import ContactGeometry

_HALVINGS = 40  # of the range in which the end of the integral is looked for


def ting_force(model: ContactModel, law: RelaxationSpectrum, time: Floats, depth: Floats, reversal: float) -> Floats:
    """Force (n,) [N] of a law on one loading and one unloading, at instants (n,) [s] and depths (n,) [m].

    While the contact grows, F(t) = 2/(1 - nu^2) int_0^t E(t - s) dA(d(s)). After the largest depth t1(t), before it,
    solves int_t1^t E(t - s) d'(s) ds = 0, and F(t) is that integral up to t1(t) only; the contact radius is a(d(t1)),
    and where no such t1 exists the tip is off. Holds are not maxima. Ways back up to `reversal` [m] are noise.
    Raises ValueError for more than one maximum.
    Source: Ting 1966; Lee and Radok 1960; by trapezoids in depth and area between the instants.
    """
    way = _TingIntegrals(model, law, time, depth, _one_maximum(depth, reversal))
    found = np.concatenate([way.loading(), way.unloading()])
    held: Any = model
    return np.asarray(2.0 / (1.0 - held.poisson**2) * np.maximum(found, 0.0))


class _TingIntegrals:
    """One loading and one unloading, with the fading sums of depth and area in loading."""

    def __init__(self, model: Any, law: RelaxationSpectrum, time: Floats, depth: Floats, peak: int) -> None:
        loaded, self._back = np.maximum.accumulate(depth[: peak + 1]), depth[peak + 1 :]
        self._time, self._later, self._peak = time[: peak + 1], time[peak + 1 :], peak
        self._speed = np.gradient(depth, time)[peak + 1 :]
        self._into, self._touching = np.maximum(loaded, 0.0), loaded > 0
        self._area = np.where(self._touching, _area(model, loaded), 0.0)
        self._rates = np.array([rate for _, rate in law.arms])
        strengths = np.array([strength for strength, _ in law.arms])
        self._lasting, self._damper = law.lasting or 0.0, 2.0 * (1.0 + model.poisson) * (law.damper or 0.0)
        # The depth's own fading sums go on over the way back.
        depths = _faded(np.concatenate([self._into, self._back]), time, self._rates, strengths)
        self._depth_sums, self._depth_sums_back = depths[: peak + 1], depths[peak + 1 :]
        self._area_sums = _faded(self._area, self._time, self._rates, strengths)

    def loading(self) -> Floats:
        """int_0^t E(t - s) dA(d(s)) (n,) while the contact grows."""
        found = self._lasting * self._area + self._area_sums.sum(axis=1)
        found = found + self._damper * np.gradient(self._area, self._time)
        return np.where(self._touching, found, 0.0)

    def unloading(self) -> Floats:
        """The same up to t1(t) only, found by halving; 0 where even the first touch is left behind."""
        if not len(self._back):
            return np.zeros(0)
        low, high = np.zeros(len(self._back)), np.full(len(self._back), float(self._peak))
        off = self._push(low) < 0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = self._push(middle) > 0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        found = self._lasting * _at(self._area, low) + self._faded_since(self._area_sums, low).sum(axis=1)
        return np.where(off, 0.0, found)

    def _push(self, at: Floats) -> Floats:
        """int_t1^t E(t - s) d'(s) ds for t1 at (fractional) places of the loading."""
        fading = (self._depth_sums_back - self._faded_since(self._depth_sums, at)).sum(axis=1)
        return np.asarray(self._lasting * (self._back - _at(self._into, at)) + fading + self._damper * self._speed)

    def _faded_since(self, sums: Floats, at: Floats) -> Floats:
        """Fading sums (m, k) of the loading up to places (m,), as they are in unloading."""
        kept = np.exp(-np.outer(self._later - _at(self._time, at), self._rates))
        return np.asarray(kept * np.column_stack([_at(column, at) for column in sums.T] or [np.zeros((len(at), 0))]))


def _one_maximum(depth: Floats, reversal: float) -> int:
    """Place of the largest depth; raises ValueError where the tip goes back and forth more than once."""
    peak = len(depth) - 1 - int(np.argmax(depth[::-1]))
    way = np.concatenate([depth[: peak + 1], 2 * depth[peak] - depth[peak + 1 :]])
    way = way[np.maximum(depth, 0.0) > 0] if (depth > 0).any() else way
    if len(way) and float(np.max(np.maximum.accumulate(way) - way)) > reversal:
        raise ValueError("Ting's unloading is for one loading and one unloading: the depth has more than one maximum")
    return peak


def _area(model: Any, depth: Floats) -> Floats:
    return np.asarray(ContactGeometry.of(model).contact(np.maximum(depth, 1e-12))[0])


def _faded(values: Floats, time: Floats, rates: Floats, strengths: Floats) -> Floats:
    """int_0^t E_k exp(-(t - s)/tau_k) dx(s) for values x (n,), which are lines between the instants: (n, k)."""
    found = np.zeros((len(values), len(rates)))
    steps, changes = np.diff(time), np.diff(values)
    turned = np.outer(steps, rates)
    keep = np.exp(-turned)
    gain = strengths * np.where(turned > 1e-12, -np.expm1(-turned) / np.maximum(turned, 1e-12), 1.0)
    found[0] = strengths * values[0]
    for i in range(len(steps)):
        found[i + 1] = keep[i] * found[i] + gain[i] * changes[i]
    return found


def _at(column: NDArray[np.float64], place: Floats) -> Floats:
    """Values at fractional places."""
    return np.interp(place, np.arange(len(column)), column)
