"""The effect of a late force on an estimate that does not know it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Diagnosed, Flag, Floats, Tail, TrackEnd, TrackEvidence
from palpate_engine import acceleration
from palpate_kit.budget.force_sensitivity import along

from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous

# Choices.
_POLYNOMIAL_DEGREE = 5  # of the elastic force over the height: above the powers 1 to 2 of tips, for layers as well
_PIECES = 12  # of the record, whose scatter is the standard error: long, so that their sums are nearly independent
_MIN_SAMPLES = 200  # that go both ways over the same depths
# Choices: the lateness that is reported, of a force ahead of its motion, which no passive material makes.
_MIN_STANDARD_ERRORS = 5.0  # [standard errors] of a lateness that is not by chance
_MIN_LATENESS = 3e-4  # [s] of a force ahead of its motion, below which it is not reported
Column = np.ndarray[tuple[int], np.dtype[np.float64]]


def late_force(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track whose contact does net work.

    Only a force that is recorded late makes a passive contact do work. The viscosity of such a track is unknown, and
    its other values are shifted by the least delay that explains the work. The real delay may be longer by as much as
    the material's own eta/G, which is not known then.
    """
    findings = {}
    for track in tracks:
        end = track.ending
        if end is None or end.is_sweep:
            continue
        lateness = force_lateness(end.tail, track.tip_mass or 0.0)
        if lateness is not None:
            findings[track.name] = _finding(track, end, lateness)
    return findings


def _finding(track: TrackEvidence, end: TrackEnd, lateness: float) -> Diagnosed:
    """Return the flag of a force that is late by at least `lateness` [s], with the shifts of the values by that.

    `end` has the latest estimates of the track, at which the model's derivatives are taken.
    """
    text = f"the contact does net work: the force is at least {1e3 * lateness:.2g} ms late"
    if not np.isfinite(track.values).all():
        text += ", which is likely why the estimates diverged: the viscosity would be negative"
        return Diagnosed((Flag("force-late", text),))
    sensitivity = along(track.model, end.tail, end.last, track.values, end.held)
    shifts = np.abs(lateness * delay_shifts(track.model, sensitivity, track.values)).tolist()
    viscous = frozenset(parameter.name for parameter in track.model.parameters if is_viscous(parameter))
    terms: dict[str, float] = {}
    for parameter, shift in zip(track.model.parameters, shifts, strict=True):
        if parameter.name not in viscous and shift > 0:
            terms[parameter.name] = shift
    flag = Flag("force-late", text, effects=terms | dict.fromkeys(sorted(viscous), math.inf))
    return Diagnosed((flag,), terms=terms, unknown=viscous)


def force_lateness(tail: Tail, tip_mass: float) -> float | None:
    """Return the least lateness [s] of the force, where the contact gives out more work than chance explains.

    `tail` has the latest samples of a track. Without the inertia of the tip (mass [kg]), the force is F = p(z) - c v:
    p any elastic law of the height z, of stiffness k = -dp/dz > 0, v the velocity (down is negative), and c > 0 in a
    material that dissipates. A force late by t is F - t dF/dt, about p(z) + (t k - c) v. The regression on v gives
    t k - c, positive where t is longer than c/k, which is the material's own eta/G. The excess t - c/k is returned;
    None without one.
    """
    contact = _contact_there_and_back(tail, tip_mass)
    if contact is None:
        return None
    # The force as a polynomial of the height, plus a multiple of the velocity, by orthonormal columns.
    polynomial = np.polynomial.chebyshev.chebvander(contact.height, _POLYNOMIAL_DEGREE).T
    *elastic, viscous = _orthonormal((*polynomial, contact.velocity))
    residual = contact.force
    for column in elastic:
        residual = residual - column * float((column * residual).sum())
    thrust = float((viscous * residual).sum())  # (t k - c) times the length of the velocity's column
    # Its standard error, by the scatter between pieces of the record.
    products = np.array_split(viscous * (residual - viscous * thrust), _PIECES)
    thrust_error = float(np.sqrt((np.array([float(piece.sum()) for piece in products]) ** 2).sum()))
    # Over that length and the mean stiffness k it is the time t - c/k.
    length = float((viscous * contact.velocity).sum())
    stiffness = contact.stiffness()
    if length <= 0 or stiffness <= 0:
        return None
    lateness = thrust / length / stiffness
    standard_error = thrust_error / length / stiffness
    return lateness if lateness > max(_MIN_LATENESS, _MIN_STANDARD_ERRORS * standard_error) else None


@dataclass(frozen=True)
class _BothWays:
    """Samples of the depths that a tip passed both ways."""

    height: Column  # height over half the range of heights, from -1 (lowest) to 1: falls as the tip goes deeper
    velocity: Column  # [m/s]
    force: Column  # [N] without the tip's inertia
    half_range: float  # [m]

    def stiffness(self) -> float:
        """Return the mean stiffness k = -dF/dz [N/m], by linear regression of the force on the height."""
        height = self.height - self.height.mean()
        product = -float(((self.force - self.force.mean()) * height).sum())
        return product * (1 / self.half_range / float((height**2).sum()))


def _contact_there_and_back(tail: Tail, tip_mass: float) -> _BothWays | None:
    """Return the samples of a tail at depths that it passed both ways; None of too few."""
    force = tail.force + tip_mass * acceleration(tail.time, tail.velocity)
    rows = np.isfinite(force) & np.isfinite(tail.velocity) & np.isfinite(tail.position)
    depths = _common_depths(tail.position[rows & (tail.velocity < 0)], tail.position[rows & (tail.velocity > 0)])
    if depths is None:
        return None
    low, high = depths
    rows &= (tail.position >= low) & (tail.position <= high)
    if np.count_nonzero(rows) < _MIN_SAMPLES or high <= low:
        return None
    height = (2 * tail.position[rows] - low - high) / (high - low)
    return _BothWays(height, velocity=tail.velocity[rows], force=force[rows], half_range=(high - low) / 2)


def _common_depths(down: Floats, up: Floats) -> tuple[float, float] | None:
    """Return the lowest and highest position [m] that samples down (n,) and up (m,) have in common; None of few."""
    if min(len(down), len(up)) < _MIN_SAMPLES / 2:
        return None
    return max(float(down.min()), float(up.min())), min(float(down.max()), float(up.max()))


def _orthonormal(columns: Iterable[Column]) -> list[Column]:
    """Return columns (n,) made orthogonal one by one, of length 1: by sums, so that every machine finds the same."""
    basis: list[Column] = []
    for column in columns:
        for earlier in basis:
            column = column - earlier * float((earlier * column).sum())
        length = float(np.sqrt((column**2).sum()))
        basis.append(column / length if length > 0 else column)
    return basis
