"""The field that a tip feels over stiffer bodies, and the fit of its bodies together with the background."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares

FWHM = 2.3548  # full width at half of the height over the standard deviation of a Gaussian: 2 sqrt(2 log 2)

# The prior of a body's width (decision 0570): 6 to 16 mm at half its height, 10 mm in the middle, for one that few
# sites see; and bounds that keep the fit finite.
_TYPICAL_SIGMA = 10e-3 / FWHM  # [m]
_SIGMA_SPREAD = 0.5  # of its logarithm
_MIN_SIGMA = 1e-3  # [m]
_MAX_SIGMA = 15e-3  # [m]
_CONTRAST_SPREAD = 0.5  # of its logarithm about the stiffest site's: of a body that is seen from one side only
_MIN_CONTRAST = 1e-4
_MAX_CONTRAST = 100.0
_MAX_SHIFT = 10e-3  # [m] of a body from where its fit starts
_GAIN = 1e-12  # of the cost, below which no further step is made: a start may differ by rounding
_NOISE_ROUNDS = 3  # of the noise, which weighs the prior of the widths
_NOISE_CHANGE = 0.05  # of the noise, below which another round changes nothing: a choice


@dataclass(frozen=True)
class SiteField:
    """Logarithms at sites, each the mean over the places that it was made of."""

    place: Floats  # (m, k) [m]
    site: NDArray[np.intp]  # (m,) site of each place
    log: Floats  # (n,)

    def mean(self, values: Floats) -> Floats:
        """Return the means (n, ...) over each site of values (m, ...) at places."""
        if len(self.site) == len(self.log):
            return values
        count = np.bincount(self.site)
        columns = values.reshape(len(values), -1).T
        means = [np.bincount(self.site, column) / count for column in columns]
        return np.array(means).T.reshape(len(count), *values.shape[1:])

    @property
    def middle(self) -> Floats:
        """(n, k) [m] middle of each site."""
        return self.mean(self.place)

    def chosen(self, rows: NDArray[np.bool_]) -> SiteField:
        """Return the field of some of the sites (n,)."""
        number = np.cumsum(rows) - 1
        kept = rows[self.site]
        return SiteField(self.place[kept], number[self.site[kept]], self.log[rows])


@dataclass(frozen=True)
class Body:
    """A stiffer body as the tip feels it: E = E0 (1 + sum of c exp(-d^2/(2 w^2)) of all bodies)."""

    place: Floats  # (k,) [m]
    contrast: float
    sigma: float  # [m] w
    axes: Floats  # (k, d) directions in which it may lie elsewhere: along a line, in the plane, along a surface

    @classmethod
    def at(cls, place: Floats, contrast: float, axes: Floats, sigma: float = _TYPICAL_SIGMA) -> Self:
        """Return a body of a place and a contrast from which a fit starts."""
        return cls(place, min(max(contrast, 1e-3), _MAX_CONTRAST), float(np.clip(sigma, _MIN_SIGMA, _MAX_SIGMA)), axes)

    @property
    def size(self) -> int:
        """Number of its unknowns: place, contrast, logarithm of the width."""
        return int(self.axes.shape[1]) + 2

    def moved(self, unknowns: Floats) -> Body:
        """Return the body of unknowns (d + 2,): shift [m] along its axes, contrast, logarithm of sigma."""
        *shift, contrast, log_sigma = unknowns.tolist()
        return replace(
            self, place=self.place + self.axes @ np.array(shift), contrast=contrast, sigma=float(np.exp(log_sigma))
        )


def rise(bodies: Sequence[Body], places: Floats) -> tuple[Floats, Floats]:
    """Return the rise (m,) of the logarithm at places (m, k) [m], log(1 + s), and its slopes (m, p) by all unknowns."""
    total, slopes = np.ones(len(places)), []
    for body in bodies:
        offset = places - body.place
        ratio = (offset**2).sum(axis=1) / body.sigma**2
        shape = np.exp(-0.5 * ratio)
        total = total + body.contrast * shape
        height = body.contrast * shape
        slopes += [height * (offset @ axis) / body.sigma**2 for axis in body.axes.T]
        slopes += [shape, height * ratio]
    columns = np.column_stack(slopes) if slopes else np.zeros((len(places), 0))
    return np.log(total), columns / total[:, None]


@dataclass(frozen=True)
class BodyFit:
    """Background and bodies, fitted together."""

    field: SiteField
    level: float  # logarithm of the background
    bodies: tuple[Body, ...]
    residual: Floats  # (n,)
    noise: float  # standard deviation of a site
    floor: float  # least standard deviation of a site
    prior: float  # sum of squares of the prior of widths and contrasts
    covariance: Floats  # (1 + p, 1 + p) of the level and of all bodies' unknowns

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the noise, one at least."""
        return max(len(self.residual) - len(self.covariance), 1)

    @property
    def deviance(self) -> float:
        """-2 log of the likelihood at its noise, the floor at least, with the prior."""
        square = float(self.residual @ self.residual)
        variance = max(self.floor**2, square / len(self.residual))
        return len(self.residual) * float(np.log(variance)) + square / variance + self.prior

    def rows_of(self, number: int) -> slice:
        """Return the rows of the covariance that are a body's unknowns."""
        first = 1 + sum(body.size for body in self.bodies[:number])
        return slice(first, first + self.bodies[number].size)

    def rise_at(self, places: Floats) -> tuple[Floats, Floats]:
        """Return the rise (m,) of the logarithm at places (m, k) [m], and its standard deviation."""
        height, slopes = rise(self.bodies, places)
        variance = np.einsum("mi,ij,mj->m", slopes, self.covariance[1:, 1:], slopes)
        return height, np.sqrt(np.maximum(variance, 0.0))

    def std_of(self, slopes: Floats) -> float:
        """Return the standard deviation of a quantity by its slopes (p,) by all bodies' unknowns."""
        return float(np.sqrt(max(float(slopes @ self.covariance[1:, 1:] @ slopes), 0.0)))


def fit_bodies(field: SiteField, bodies: Sequence[Body], floor: float, shift_sigmas: float = np.inf) -> BodyFit:
    """Return the least-squares fit of a level and bodies to the sites' logarithms, from the bodies given.

    `field` has the logarithm of each site and the places that it is the mean over. A body moves by 10 mm at most, and
    by `shift_sigmas` of its sigmas; `floor` is the least noise of a logarithm.

    The residuals are those of the sites, over a noise that they determine, and of the logarithms of widths and of
    contrasts about their starts, over the spread of their prior. Covariance: (J'J)^-1 with the prior's rows in J.
    """
    starts = tuple(bodies)
    start, low, high = _unknowns_and_bounds(_level(field, starts), starts, shift_sigmas)
    # The level is the unknown 0, and a body's width is the last of its own unknowns.
    width_rows = np.cumsum([body.size for body in starts], dtype=int)
    system = _Equations(field, starts, width_rows)
    unknowns, noise = start, floor
    residual: Floats = np.zeros(0)
    # Fit and noise in turn, until the noise stays: noise^2 = r'r over the degrees of freedom.
    for _ in range(_NOISE_ROUNDS if starts else 1):
        unknowns = least_squares(partial(system.normal, noise=noise), unknowns, low, high, gain=_GAIN).x
        residual, _ = system.site_rows(unknowns)
        freedom = max(len(residual) - len(start), 1)
        previous_noise = noise
        noise = max(floor, float(np.sqrt(residual @ residual / freedom)))
        if abs(noise / previous_noise - 1) < _NOISE_CHANGE:
            break
    # J'J is [r, J]'[r, J] without the row and column of the residual.
    square: Floats = system.normal(unknowns, noise)
    covariance: Floats = np.asarray(np.linalg.pinv(square[1:, 1:], hermitian=True), float)
    return BodyFit(
        field=field,
        level=float(unknowns[0]),
        bodies=system.bodies(unknowns),
        residual=residual,
        noise=noise,
        floor=floor,
        prior=float(np.square(system.prior_rows(unknowns)[:, 0]).sum()),
        covariance=covariance,
    )


def _unknowns_and_bounds(level: float, bodies: Sequence[Body], shift_sigmas: float) -> tuple[Floats, Floats, Floats]:
    """Return the unknowns of a fit where it starts, and their lower and upper bounds.

    They are the level, and of each body its shift [m] in two or three coordinates, its contrast and log sigma.
    """
    start, low, high = [level], [-np.inf], [np.inf]
    for body in bodies:
        shift_count = body.size - 2
        farthest = min(_MAX_SHIFT, shift_sigmas * body.sigma)
        low += [-farthest] * shift_count + [_MIN_CONTRAST, np.log(_MIN_SIGMA)]
        high += [farthest] * shift_count + [_MAX_CONTRAST, np.log(_MAX_SIGMA)]
        start += [0.0] * shift_count + [body.contrast, np.log(body.sigma)]
    return np.array(start), np.array(low), np.array(high)


def _level(field: SiteField, bodies: Sequence[Body]) -> float:
    """Return the median of the logarithms without the bodies."""
    return float(np.median(field.log - field.mean(rise(bodies, field.place)[0])))


@dataclass(frozen=True)
class _Equations:
    """Residuals of sites and of widths, as normal equations."""

    field: SiteField
    starts: tuple[Body, ...]
    width_rows: NDArray[np.int_]  # (K,) index of each logarithm of a width among the unknowns

    def bodies(self, unknowns: Floats) -> tuple[Body, ...]:
        """Return the bodies of unknowns (1 + p,)."""
        ends = np.cumsum([0, *(body.size for body in self.starts)]) + 1
        return tuple(
            body.moved(unknowns[first:last]) for body, first, last in zip(self.starts, ends[:-1], ends[1:], strict=True)
        )

    def site_rows(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Return the residuals (n,), measurement minus model, and the slopes (n, 1 + p) of the model."""
        height, slopes = rise(self.bodies(unknowns), self.field.place)
        residual = self.field.log - unknowns[0] - self.field.mean(height)
        return residual, np.column_stack([np.ones(len(residual)), self.field.mean(slopes)])

    def prior_rows(self, unknowns: Floats) -> Floats:
        """Return residuals and slopes (2 K, 2 + p) of the logarithms of widths and contrasts, over their spreads."""
        count = len(self.starts)
        numbers, contrasts = np.arange(count), self.width_rows - 1
        rows = np.zeros((2 * count, 1 + len(unknowns)))
        rows[:count, 0] = (np.log(_TYPICAL_SIGMA) - unknowns[self.width_rows]) / _SIGMA_SPREAD
        rows[numbers, 1 + self.width_rows] = -1 / _SIGMA_SPREAD
        start = np.array([body.contrast for body in self.starts])
        rows[count:, 0] = (np.log(start) - np.log(unknowns[contrasts])) / _CONTRAST_SPREAD
        rows[count + numbers, 1 + contrasts] = -1 / (_CONTRAST_SPREAD * unknowns[contrasts])
        return rows

    def normal(self, unknowns: Floats, noise: float) -> Floats:
        """Return [r, J]' [r, J] (2 + p, 2 + p) of the residuals in standard deviations, J the slopes of r."""
        residual, slopes = self.site_rows(unknowns)
        rows = np.vstack([np.column_stack([residual, -slopes]) / noise, self.prior_rows(unknowns)])
        return np.asarray(rows.T @ rows)
