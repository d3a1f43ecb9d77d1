"""Unloading after Ting (1966): on the way back the contact shrinks faster than the depth alone would have it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats

from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_models.relaxation import Relaxing, Spectrum
from palpate_models.thickness import corrected_contact

_REVERSAL = 1e-6  # [m]; a smaller way back is none


def ting_force(
    model: ContactModel, time: Floats, depth: Floats, theta: Sequence[float], reversal: float = _REVERSAL
) -> Floats:
    """Force (n,) [N] on one loading and one unloading, at instants (n,) [s] and depths (n,) [m].

    While the contact grows, F(t) = 2/(1 - nu^2) int_0^t E(t - s) dA(d(s)). After the largest depth t1(t), before it,
    solves int_t1^t E(t - s) d'(s) ds = 0, and F(t) is that integral up to t1(t) only; the contact radius is a(d(t1)),
    and where there is no such t1 the tip is off. Holds are no maxima. Ways back up to `reversal` [m] are noise.
    Raises ValueError for more than one maximum, and for a model whose relaxation is none of a linear material's.
    Source: Ting 1966; Lee and Radok 1960; by trapezoids in depth and area between the instants.
    """
    law = relaxation_of(model, theta)
    peak = _one_maximum(depth, reversal)
    held: Any = model
    loaded, back = np.maximum.accumulate(depth[: peak + 1]), depth[peak + 1 :]
    area = np.where(loaded > 0, _area(held, loaded), 0.0)
    rates = np.array([rate for _, rate in law.arms])
    strengths = np.array([strength for strength, _ in law.arms])
    into = np.maximum(loaded, 0.0)
    q, p = (_faded(values, time[: peak + 1], rates, strengths) for values in (area, into))
    lasting, damper = law.lasting or 0.0, 2.0 * (1.0 + held.poisson) * (law.damper or 0.0)
    speed = np.gradient(depth, time)
    loading = lasting * area + q.sum(axis=1) + damper * np.gradient(area, time[: peak + 1])
    loading = np.where(loaded > 0, loading, 0.0)
    found = np.zeros(len(time))
    found[: peak + 1] = loading
    if len(back):
        later = time[peak + 1 :]
        # The depth's own fading sums go on over the way back.
        whole = _faded(np.concatenate([into, back]), time, rates, strengths)[peak + 1 :]

        def push(at: Floats) -> Floats:
            """Int_t1^t E(t - s) d'(s) ds for t1 at (fractional) places of the loading."""
            kept = np.exp(-np.outer(later - _at(time[: peak + 1], at), np.ones(len(rates))) * rates)
            return np.asarray(
                lasting * (back - _at(into, at))
                + (whole - kept * np.column_stack([_at(column, at) for column in p.T] or [np.zeros((len(at), 0))])).sum(
                    axis=1
                )
                + damper * speed[peak + 1 :]
            )

        low, high = np.zeros(len(back)), np.full(len(back), float(peak))
        off = push(low) < 0  # even the first touch is left behind
        for _ in range(40):
            middle = (low + high) / 2
            above = push(middle) > 0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        kept = np.exp(-np.outer(later - _at(time[: peak + 1], low), np.ones(len(rates))) * rates)
        states = np.column_stack([_at(column, low) for column in q.T] or [np.zeros((len(low), 0))])
        found[peak + 1 :] = np.where(off, 0.0, lasting * _at(area, low) + (kept * states).sum(axis=1))
    return np.asarray(2.0 / (1.0 - held.poisson**2) * np.maximum(found, 0.0))


def relaxation_of(model: ContactModel, theta: Sequence[float]) -> Spectrum:
    """The relaxation modulus of a model; raises ValueError where it has none."""
    if isinstance(model, DimensionalityReduction):
        return Spectrum(theta[0], theta[1], ())
    if isinstance(model, Relaxing) and model.pace(1e-3, theta) is None:
        return model.spectrum(theta)
    raise ValueError(f"Ting's unloading wants a linear material with a relaxation modulus, not {type(model).__name__}")


def _one_maximum(depth: Floats, reversal: float) -> int:
    """Place of the largest depth; raises ValueError where the tip goes back and forth more than once."""
    peak = len(depth) - 1 - int(np.argmax(depth[::-1]))
    way = np.concatenate([depth[: peak + 1], 2 * depth[peak] - depth[peak + 1 :]])
    way = way[np.maximum(depth, 0.0) > 0] if (depth > 0).any() else way
    if len(way) and float(np.max(np.maximum.accumulate(way) - way)) > reversal:
        raise ValueError("Ting's unloading is for one loading and one unloading: the depth has more than one maximum")
    return peak


def _area(model: Any, depth: Floats) -> Floats:
    return np.asarray(corrected_contact(model.indenter, model.thickness, np.maximum(depth, 1e-12))[0])


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
