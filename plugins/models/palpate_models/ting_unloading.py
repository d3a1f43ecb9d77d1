"""Unloading after Ting (1966): the contact shrinks faster than by the depth alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats

from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.skin import ContactGeometry

_HALVINGS = 40  # a choice: of the loading's samples, in the search for t1; 1e-12 of them
_MIN_DEPTH = 1e-12  # [m], a choice: keeps powers of a depth finite out of contact
_MIN_EXPONENT = 1e-12  # a choice: below it (1 - exp(-x))/x is 1 to rounding


def ting_force(model: ContactModel, law: RelaxationSpectrum, time: Floats, depth: Floats, reversal: float) -> Floats:
    """Return the force (n,) [N] of a law on one loading and one unloading, at instants (n,) [s] and depths (n,) [m].

    While the contact grows, F(t) = 2/(1 - nu^2) int_0^t E(t - s) dA(d(s)). After the largest depth t1(t), before it,
    solves int_t1^t E(t - s) d'(s) ds = 0, and F(t) is that integral up to t1(t) only; the contact radius is a(d(t1)),
    and where no such t1 exists the tip is off. Holds are not maxima. Ways back up to `reversal` [m] are noise.
    Raises ValueError for more than one maximum.
    Source: Ting 1966; Lee and Radok 1960; by trapezoids in depth and area between the instants.
    """
    integrals = _TingIntegrals(model=model, law=law, time=time, depth=depth, peak=_one_maximum(depth, reversal))
    integral = np.concatenate([integrals.loading(), integrals.unloading()])
    poisson: float = model.poisson  # type: ignore[attr-defined]
    return np.asarray(2.0 / (1.0 - poisson**2) * np.maximum(integral, 0.0))


class _TingIntegrals:
    """One loading and one unloading, with the fading sums of depth and area in loading."""

    def __init__(self, model: Any, law: RelaxationSpectrum, time: Floats, depth: Floats, peak: int) -> None:
        """Take a model, its relaxation, and times [s] and depths [m] (n,) of a press, deepest at the row `peak`."""
        # The loading, where the depth only grows, and the unloading.
        loading, self._unloading_depth = np.maximum.accumulate(depth[: peak + 1]), depth[peak + 1 :]
        self._time, self._unloading_time, self._peak = time[: peak + 1], time[peak + 1 :], peak
        self._unloading_speed = np.gradient(depth, time)[peak + 1 :]
        self._depth, self._touching = np.maximum(loading, 0.0), loading > 0
        self._area = np.where(self._touching, _area(model, loading), 0.0)
        # The material: a lasting modulus, arms of strength and rate, and a damper by 2 (1 + nu) times its viscosity.
        self._rates = np.array([rate for _, rate in law.arms])
        strengths = np.array([strength for strength, _ in law.arms])
        self._lasting = law.lasting or 0.0
        self._damper = 2.0 * (1.0 + model.poisson) * (law.damper or 0.0)
        # The fading sums of the depth continue over the unloading.
        sums = _fading_sums(np.concatenate([self._depth, self._unloading_depth]), time, self._rates, strengths)
        self._depth_sums, self._unloading_depth_sums = sums[: peak + 1], sums[peak + 1 :]
        self._area_sums = _fading_sums(self._area, self._time, self._rates, strengths)

    def loading(self) -> Floats:
        """Return int_0^t E(t - s) dA(d(s)) (n,) while the contact grows."""
        integral = self._lasting * self._area + self._area_sums.sum(axis=1)
        integral = integral + self._damper * np.gradient(self._area, self._time)
        return np.where(self._touching, integral, 0.0)

    def unloading(self) -> Floats:
        """Return the same up to t1(t) only, by halving; 0 where even the first touch is before t1."""
        count = len(self._unloading_depth)
        if not count:
            return np.zeros(0)
        low, high = np.zeros(count), np.full(count, float(self._peak))
        is_off = self._push(low) < 0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = self._push(middle) > 0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        fading = self._fading_since(self._area_sums, low).sum(axis=1)
        return np.where(is_off, 0.0, self._lasting * _at(self._area, low) + fading)

    def _push(self, at: Floats) -> Floats:
        """Return int_t1^t E(t - s) d'(s) ds for t1 at (fractional) samples of the loading."""
        fading = (self._unloading_depth_sums - self._fading_since(self._depth_sums, at)).sum(axis=1)
        lasting = self._lasting * (self._unloading_depth - _at(self._depth, at))
        return np.asarray(lasting + fading + self._damper * self._unloading_speed)

    def _fading_since(self, sums: Floats, at: Floats) -> Floats:
        """Return the fading sums (m, k) of the loading up to samples (m,), faded until the unloading."""
        decay = np.exp(-np.outer(self._unloading_time - _at(self._time, at), self._rates))
        columns = [_at(column, at) for column in sums.T]
        return np.asarray(decay * np.column_stack(columns or [np.zeros((len(at), 0))]))


def _one_maximum(depth: Floats, reversal: float) -> int:
    """Return the row of the largest depth; raises ValueError where the tip turns back more than once."""
    peak = len(depth) - 1 - int(np.argmax(depth[::-1]))
    # The unloading mirrored at the peak: with one maximum the whole travel grows, but for noise.
    travel = np.concatenate([depth[: peak + 1], 2 * depth[peak] - depth[peak + 1 :]])
    if (depth > 0).any():
        travel = travel[np.maximum(depth, 0.0) > 0]
    if len(travel) and float(np.max(np.maximum.accumulate(travel) - travel)) > reversal:
        raise ValueError("Ting's unloading is for one loading and one unloading: the depth has more than one maximum")
    return peak


def _area(model: Any, depth: Floats) -> Floats:
    return np.asarray(ContactGeometry.of(model).contact(np.maximum(depth, _MIN_DEPTH))[0])


def _fading_sums(values: Floats, time: Floats, rates: Floats, strengths: Floats) -> Floats:
    """Return int_0^t E_k exp(-(t - s)/tau_k) dx(s) (n, k) for values x (n,), which are lines between the instants.

    Over a step T with x = T/tau_k, a sum decays by exp(-x), and a change adds E_k (1 - exp(-x))/x times itself.
    """
    sums = np.zeros((len(values), len(rates)))
    steps, changes = np.diff(time), np.diff(values)
    x = np.outer(steps, rates)
    decay = np.exp(-x)
    gain = strengths * np.where(x > _MIN_EXPONENT, -np.expm1(-x) / np.maximum(x, _MIN_EXPONENT), 1.0)
    sums[0] = strengths * values[0]
    for i in range(len(steps)):
        sums[i + 1] = decay[i] * sums[i] + gain[i] * changes[i]
    return sums


def _at(column: NDArray[np.float64], place: Floats) -> Floats:
    """Return values at fractional rows."""
    return np.interp(place, np.arange(len(column)), column)
