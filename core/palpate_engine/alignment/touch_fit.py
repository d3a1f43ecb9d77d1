"""Air and a law of contact, fitted together to the means of a record.

Numbers are choices of decision 0375.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.change_point import white_noise

# Acceleration, by second differences of the height.
_PULSE = 0.05  # [s] over which it is taken
_MIN_SAMPLES_PER_PULSE = 20  # of the record to one of half a pulse
_ACCELERATION_SIGMAS = 4.0  # of its noise, below which it counts as none

# The search for the surface, each level over two steps of the grid before: 8192nds of the way.
_GRID_SIZE = 33  # heights that are tried together
_GRID_LEVELS = 3
_MIN_SHARE = 1e-6  # of a term that other terms leave, below which it counts as zero: noise and rounding
_MIN_SHAPE_SHARE = 1e-9  # the same of the square of a law's shape


@dataclass(frozen=True)
class Averages:
    """Means of the readings of a record, in equal blocks."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N]
    height: Floats  # (n,) [m]
    acceleration: Floats | None = None  # (n,) [m/s2] of the height; None where none is above its noise


@dataclass(frozen=True)
class TouchFit:
    """A law of contact, fitted to the means of a record together with what air may give."""

    surface: float  # [m]
    gain: float  # [N2] by which the law lowers the sum of squares
    rise: float  # [N] of the law, less what air explains of it
    residual: Floats  # (n,) [N] of air and law
    air_residual: Floats  # (n,) [N] of air alone
    air_basis: Floats  # (n, k), orthonormal terms of air


def averaged(samples: Samples, size: int) -> Averages:
    """Return the means of blocks of `size` samples; an incomplete last block is left out."""
    columns = (samples.time, samples.force, samples.position)
    blocks = (column[: len(column) // size * size].reshape(-1, size) for column in columns)
    return Averages(*(np.asarray(block.mean(axis=1)) for block in blocks))


def with_acceleration(averages: Averages) -> Averages:
    """Return averages by a triangle, with the acceleration: the second difference of the height is that average.

    So that force and acceleration are of one instant, however short a pulse. Unchanged where the record is too short.
    """
    time, force, height = averages.time, averages.force, averages.height
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    reach = 0  # samples of half a triangle's base
    if interval > 0:
        reach = min(max(round(_PULSE / interval), 1), len(time) // _MIN_SAMPLES_PER_PULSE)
    if reach < 1:
        return averages
    acceleration = (height[2 * reach :] - 2.0 * height[reach:-reach] + height[: -2 * reach]) / (reach * interval) ** 2
    # The second difference of white noise has the variance (1 + 4 + 1) sigma^2.
    noise = np.sqrt(6.0) * white_noise(height) / (reach * interval) ** 2
    acceleration = np.where(np.abs(acceleration) > _ACCELERATION_SIGMAS * noise, acceleration, 0.0)
    weights = np.convolve(np.ones(reach), np.ones(reach)) / reach**2
    force, height = (np.convolve(column, weights, "valid")[1:-1] for column in (force, height))
    return Averages(time[reach:-reach], force, height, acceleration if acceleration.any() else None)


def fit_touch(averages: Averages, max_mass: float) -> TouchFit | None:
    """Return the law of contact whose surface lowers the sum of squares most; None where no surface lowers it."""
    basis, force = _air_model(averages, max_mass)
    air_residual = force - basis @ (basis.T @ force)
    gain, surface, slope = _best_surface(averages.height, basis, air_residual)
    if gain <= 0.0:
        return None
    law = slope * np.maximum(surface - averages.height, 0.0) ** 1.5
    law -= basis @ (basis.T @ law)
    return TouchFit(
        surface=surface,
        gain=gain,
        rise=float(np.ptp(law)),
        residual=air_residual - law,
        air_residual=air_residual,
        air_basis=basis,
    )


def air_terms(averages: Averages) -> list[Floats]:
    """Return what air may give but for inertia: the sensor's zero, its drift, and travel with a cable or a tilt."""
    time, height = averages.time, averages.height
    return [np.ones(len(time)), time - time.mean(), height - height.mean()]


def _air_model(averages: Averages, max_mass: float) -> tuple[Floats, Floats]:
    """Return orthonormal terms (n, k) of air, and the force (n,) [N] that they explain, with the mass in its limits.

    A fitted mass within them is a term; one beyond them is fixed at the limit, and its inertia taken off the force.
    """
    terms, force, acceleration = air_terms(averages), averages.force, averages.acceleration
    if acceleration is not None:
        mass = float(np.linalg.lstsq(np.column_stack([*terms, -acceleration]), force, rcond=None)[0][-1])
        if 0.0 < mass <= max_mass:
            terms.append(-acceleration)
        elif mass > max_mass:
            force = force + max_mass * acceleration
    return basis_of(terms), force


def _best_surface(height: Floats, basis: Floats, air_residual: Floats) -> tuple[float, float, float]:
    """Return the largest gain [N2], its surface [m] and slope [N/m^1.5]; gain 0 where the force never rises.

    With the shape s = (z_s - z)^1.5 less its projection on air, and the residual r of air, the slope is s.r / |s|^2 and
    the gain (s.r)^2 / |s|^2.
    """
    low, high = float(height.min()), float(height.max())
    best = (0.0, 0.0, 0.0)
    for _ in range(_GRID_LEVELS):
        surfaces = np.linspace(low, high, _GRID_SIZE)
        shape = np.maximum(surfaces[:, None] - height, 0.0)
        shape *= np.sqrt(shape)
        shape_square = np.einsum("ij,ij->i", shape, shape)
        projection = shape @ basis
        square = shape_square - np.einsum("ij,ij->i", projection, projection)
        product = shape @ air_residual
        is_positive = (square > _MIN_SHAPE_SHARE * shape_square) & (product > 0.0)
        gains = np.where(is_positive, product**2 / np.where(is_positive, square, 1.0), 0.0)
        best_row = int(np.argmax(gains))
        if gains[best_row] > best[0]:
            best = float(gains[best_row]), float(surfaces[best_row]), float(product[best_row] / square[best_row])
        low, high = float(surfaces[max(best_row - 1, 0)]), float(surfaces[min(best_row + 1, _GRID_SIZE - 1)])
    return best


def basis_of(terms: list[Floats]) -> Floats:
    """Return orthonormal columns (n, k) that span the terms, fewer where these depend: at one speed travel is time."""
    columns = np.column_stack([term / (np.linalg.norm(term) or 1.0) for term in terms])
    vectors, sizes, _ = np.linalg.svd(columns, False)
    return np.asarray(vectors[:, sizes > _MIN_SHARE * sizes[0]], float)
